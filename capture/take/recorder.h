/* recorder.h - records takes (take.h) beside a running capture: the capture's tap, a bounded queue, a thread that
 * writes, a thread that syncs.
 *
 * A set waits in the queue by reference, without a copy, so a camera needs `queue` more frame buffers.  When the
 * queue is full, the newest set is left out and listed in the take as a gap.  The live solve never waits for the
 * disk.  The recorder gets all sets that are given out, also partial ones, and the good frames without a set.  It does
 * not get frames that capture refuses or loses (enum cap_count): their numbers are missing between the rows.
 * Every set is committed and survives the end of the process at any moment.  A sync makes it survive a power cut too.
 * It begins every sync_ns and when the take is closed.
 * A full disk, a limit or an error ends the recording in order, with a message.  Capture goes on.
 * A recording that rolls goes on in a new take when the current one is roll_ns old.  Every set is in one of the takes,
 * or is a gap of one.  The second of NAME.h5 is NAME-0002.h5.
 * Threads: start and stop from one thread at a time, stats and hurry from any.  The tap allocates nothing and
 * does not wait (lossless: it waits for room in the queue). */
#ifndef CAP_RECORDER_H
#define CAP_RECORDER_H
#include "capture/sync/frameset.h"
#include "capture/take/take.h"

/* Half of all set structs (frameset.c). */
#define CAP_RECORDER_QUEUE_MAX 64

struct cap_recorder_config {
    uint32_t n_cameras;
    unsigned queue;           /* frames of each camera that may wait, 1..CAP_RECORDER_QUEUE_MAX;
                                 never more sets wait than that maximum, also partial ones */
    bool lossless;            /* capture waits for the disk */
    uint64_t limit_bytes;     /* of pixels in one take; 0 = none */
    uint64_t keep_free_bytes; /* end the recording before the disk has less */
    int64_t sync_ns;          /* 0 = never */
    int64_t roll_ns;          /* length of a take; 0 = one take of any length */
    /* Reads a camera's state; the tap calls it for each of its frames in a set.  NULL = not known. */
    void (*health)(void *ctx, uint32_t camera, struct cap_health *out);
    /* Puts other rows into the take: the writer's thread calls it after each set, and before it closes the take.
     * NULL = there are none. */
    pvx_err (*beside)(void *ctx, cap_take_writer *w, struct pvx_diag *d);
    void *ctx;
};
enum cap_recorder_state { CAP_REC_IDLE, CAP_REC_RUNNING, CAP_REC_ENDED, CAP_REC_FAILED };
extern const char *const cap_recorder_state_names[];

struct cap_recorder_stats {
    enum cap_recorder_state state;
    char path[512];                /* of the last take */
    unsigned takes;                /* of this recording; the counts cover all of them */
    uint64_t sets, frames, strays; /* written; strays: the frames among these that are in no set */
    uint64_t bytes;                /* of pixels */
    uint64_t sets_missed;          /* not recorded: queue full */
    uint64_t frames_missed;
    unsigned queued;
    double seconds;  /* of the recording, so far */
    char error[512]; /* why it ended by itself; "" = it did not */
};

typedef struct cap_recorder cap_recorder;
PVX_MUST_CHECK pvx_err cap_recorder_new(const struct cap_recorder_config *c, cap_recorder **out);
struct cap_tap cap_recorder_tap(cap_recorder *r);
/* Begin a take.  head is read during the call; with takes that roll, until the stop.  Errors: PVX_EBUSY (a take is
 * being recorded), PVX_ENOSPC (the disk has no more than keep_free_bytes and some; nothing was made), else as
 * cap_take_create. */
PVX_MUST_CHECK pvx_err cap_recorder_start(cap_recorder *r, const char *path,
                                          const struct cap_take_head *head, struct pvx_diag *d);
/* For a lossless recording, before the capture is stopped, because that waits for the tap.  From now on the tap waits
 * for room no longer than 5 s in all, so that a disk that does not answer delays no other thread. */
void cap_recorder_hurry(cap_recorder *r);
/* Write what waits, close the take, and log a summary.  PVX_OK: the take is whole.  PVX_ENOENT: no take is being
 * recorded.  PVX_ETIMEDOUT: the disk took nothing for 10 s (may be called again; until the disk answers, start
 * returns PVX_EBUSY).  Else: why the recording ended by itself. */
pvx_err cap_recorder_stop(cap_recorder *r, struct pvx_diag *d);
void cap_recorder_stats(cap_recorder *r, struct cap_recorder_stats *out);
void cap_recorder_free(cap_recorder **r); /* stops; the tap must not be called any more.
                                             If the disk does not answer, the threads keep the memory */
#endif
