/* ring.h - the last seconds of raw frames in memory, and the takes that triggers make of them.
 *
 *     capture's tap -> [ring: the newest frames] -> ring's thread -> recorder (recorder.h) -> take
 *
 * The ring keeps sets and frames without a set by reference, without a copy.  So each camera needs `frames` +
 * CAP_RING_MORE more buffers, and the assembler as many more sets (cap_source_config.held, cap_assembler_params.held).
 * The oldest leave when a bound is reached: frames of a camera, or bytes in all.
 * A trigger asks for all frames exposed from `pre` before its instant to `post` after it.  The ring's thread writes a
 * take of them.  A slow disk loses nothing as long as the frames are still in the ring.  A trigger whose time overlaps
 * with that of a take under way makes this one longer.  Others wait.
 * A take names its triggers, and every frame that it should have and has not, with the cause (struct cap_take_lost).
 * The causes of capture (cap_count_defs) are found by the gaps in a camera's numbers and by what capture has counted
 * meanwhile.  Where two causes occur within some frames of a camera, which of them took which frame may be swapped.
 * Threads: the tap from one thread; start, stop and free from another; trigger and stats from any.  The tap and trigger
 * do not wait and allocate nothing. */
#ifndef CAP_TAKE_RING_H
#define CAP_TAKE_RING_H
#include "capture/take/recorder.h"

#define CAP_RING_QUEUE 4 /* sets on their way to the disk, which the ring may no longer have */
#define CAP_RING_MORE  (CAP_RING_QUEUE + 1) /* and one that the tap has */

/* Why frames are lost: a cap_count, or one of these. */
enum cap_ring_why {
    CAP_RING_OUTRUN = CAP_N_COUNT, /* left the ring before the disk took them */
    CAP_RING_BEFORE,               /* had left the ring before the trigger came */
    CAP_RING_DISK,                 /* the take could not be written */
    CAP_RING_STOPPED,              /* capture was stopped before `post` was over */
    CAP_RING_SILENT,               /* the camera sent no frame */
    CAP_RING_UNKNOWN,              /* numbers are missing, but capture counted nothing */
    CAP_RING_N_WHY
};
const char *cap_ring_why_name(enum cap_ring_why why);

struct cap_ring_config {
    uint32_t n_cameras;
    uint32_t frames;    /* of each camera, at most */
    uint64_t bytes;     /* of pixels in all, at most */
    uint64_t set_bytes; /* of a whole set, as it was counted for the bound; 0 = not known */
    double fps;         /* nominal, > 0 */
    uint64_t limit_bytes, keep_free_bytes; /* as in cap_recorder_config */
    int64_t sync_ns;
    struct cap_tap next; /* gets the same frames; its functions may be NULL */
    void (*health)(void *ctx, uint32_t camera, struct cap_health *out); /* or NULL */
    /* What capture has counted for the camera.  NULL: causes of capture are CAP_RING_UNKNOWN. */
    void (*counts)(void *ctx, uint32_t camera, uint64_t out[CAP_N_COUNT]);
    /* Path and head of a take; called by the ring's thread. */
    pvx_err (*place)(void *ctx, const struct cap_take_trigger *first, char *path, size_t size,
                     struct cap_take_head *head, struct pvx_diag *d);
    void *ctx;
};

struct cap_ring_stats {
    uint32_t frames;                       /* of each camera, at most; 0 = there is no ring */
    uint64_t bytes_max, bytes, bytes_most; /* the bound; now; the most so far */
    uint32_t held;                         /* frames of the camera that has most */
    double seconds;                        /* from the oldest to the newest */
    uint64_t triggers, extended;           /* orders; of these, such that made a take longer */
    unsigned waiting;                      /* orders for a take that has not begun */
    uint64_t takes, failed;                /* closed; could not be begun or ended early */
    uint64_t written;                      /* frames */
    uint64_t lost[CAP_RING_N_WHY];         /* frames, of all takes */
    bool writing;
    uint64_t behind; /* sets and single frames that the take at hand still waits for in the ring */
    char name[CAP_TAKE_TRIGGER_MAX]; /* the trigger of the last take */
    int64_t t_ns;                    /* its instant */
    char path[512];                  /* that take */
    char error[512];                 /* why the last that failed did; "" = none */
};

typedef struct cap_ring cap_ring;
/* Errors: PVX_EINVAL, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_ring_new(const struct cap_ring_config *c, cap_ring **out);
struct cap_tap cap_ring_tap(cap_ring *r);
PVX_MUST_CHECK pvx_err cap_ring_start(cap_ring *r, struct pvx_diag *d);
/* t: name, instant, set, latency and the times from and to.  PVX_ECLOSED: the ring has been stopped. */
PVX_MUST_CHECK pvx_err cap_ring_trigger(cap_ring *r, const struct cap_take_trigger *t);
void cap_ring_stats(cap_ring *r, struct cap_ring_stats *out);
/* After capture has been stopped: writes what was asked for and is there, and releases all frames.  Does not wait for
 * a disk that takes nothing (cap_recorder_stop). */
void cap_ring_stop(cap_ring *r);
void cap_ring_free(cap_ring **r); /* stops; the tap must not be called any more */
#endif
