/* frameset.h - frames of N cameras grouped by exposure time.
 *
 * A set has all frames whose mapped exposure times lie within `tolerance` of each other.  Arrival and counting
 * play no part.  Open sets are kept in order of time.  A set closes when
 *     - it has a frame of every camera that is alive,
 *     - a newer set is given out,
 *     - every camera that it lacks is gone or has sent a later frame (frames of one camera come in order), or
 *     - its deadline has passed (first arrival + max_wait).
 * Sets come out in order of exposure.  A set that closes without all cameras:
 *     DROP     is dropped, and its frames are counted UNMATCHED; while a camera is gone nothing comes out
 *     WAIT     is given out if only cameras that are not alive are missing, else dropped; so no set lacks a
 *              living camera, and slow frames are waited for longer
 *     PARTIAL  is given out as it is (the solver uses the cameras that it has)
 * The latter two need at least min_cameras.
 * A frame of a closed set, or an older one, is LATE.  A second frame of a camera for the same set is UNMATCHED.
 * When the consumer holds all set structs, a frame is an OVERFLOW.  When every frame is late for long (clocks
 * stepped back), the order starts again.
 * Frames of a recording with known sets (frame.set) join only those: the replay has the recording's sets, with
 * their numbers.
 * Invariant (tested): frames put == frames in emitted sets + late + unmatched + overflow + open.
 * Threads: one thread (the assembler's); cap_set_release from any.  Allocates nothing after new. */
#ifndef CAP_FRAMESET_H
#define CAP_FRAMESET_H
#include "capture/source/source.h"

#define CAP_MAX_CAMERAS 64
enum cap_policy { CAP_POLICY_DROP, CAP_POLICY_PARTIAL, CAP_POLICY_WAIT };

struct cap_set {
    uint64_t number;        /* 0, 1, 2 ... as emitted */
    int64_t t_exposure_ns;  /* mean of the members, host CLOCK_REALTIME */
    int64_t spread_ns;      /* latest - earliest exposure */
    int64_t t_last_mono_ns; /* arrival of the last member, CLOCK_MONOTONIC: latency starts here */
    uint32_t n;             /* members */
    struct cap_frame *frame[CAP_MAX_CAMERAS]; /* NULL = missing */
};
/* A set has a reference count and comes with one reference.  Each holder releases its own.  The last release
 * releases the frames, and the struct goes back to its pool. */
void cap_set_ref(struct cap_set *s);
void cap_set_release(struct cap_set *s);

/* A second receiver of the frames beside the consumer: a recorder.  Called by the assembler's thread.  Must return
 * at once, unless everything may wait (lossless).  Each function may be NULL. */
struct cap_tap {
    void (*set)(void *ctx, struct cap_set *s); /* s is given out next; cap_set_ref to keep it */
    /* Takes a good frame that is in no set, counted under `why`. */
    void (*stray)(void *ctx, struct cap_frame *f, enum cap_count why);
    void *ctx;
};

struct cap_assembler_params {
    uint32_t cameras;
    int64_t tolerance_ns; /* 0 = a quarter of the period; must be less than half of it */
    int64_t max_wait_ns;  /* 0 = 150 ms; WAIT: 500 ms (frames are held meanwhile: needs buffers) */
    int64_t period_ns;    /* nominal, from fps; 0 = unknown (then tolerance must be given) */
    enum cap_policy policy;
    uint32_t min_cameras; /* PARTIAL, WAIT: fewer are dropped */
    uint32_t held; /* sets that a receiver beside the consumer keeps for long (take/ring.h) */
};
typedef struct cap_assembler cap_assembler;
/* All cameras count as alive at first.  Only ctx, count and push of `counts` are used.  push takes each frame that
 * did not become part of a set, right after the count with the reason.  push NULL: the frame is released.
 * Errors: PVX_EINVAL (cameras 1..64, tolerance), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_assembler_new(const struct cap_assembler_params *p,
                                         const struct cap_sink *counts, cap_assembler **out);
/* Releases open and finished sets; those that the consumer has stay valid. */
void cap_assembler_free(cap_assembler **a);
/* Takes f.  Any sets that this completes come out of cap_assembler_pop. */
void cap_assembler_put(cap_assembler *a, struct cap_frame *f);
/* Takes f, whose time is not known well enough to match it, and counts it UNMATCHED. */
void cap_assembler_refuse(cap_assembler *a, struct cap_frame *f);
/* Tell the assembler whether a camera is alive.  It does not wait for the others. */
void cap_assembler_alive(cap_assembler *a, uint32_t camera, bool alive);
/* Close the sets that are overdue at now_mono_ns. */
void cap_assembler_tick(cap_assembler *a, int64_t now_mono_ns);
/* Mono time when tick will have a set to close; INT64_MAX = no set is open. */
int64_t cap_assembler_deadline(const cap_assembler *a);
/* The clock of the exposure times was stepped by `by_ns`: open sets and the limit of late frames move along. */
void cap_assembler_shift(cap_assembler *a, int64_t by_ns);
/* The frames' own clocks were stepped: no frame counts as late until the next set is given out. */
void cap_assembler_forget_order(cap_assembler *a);
/* Replay in order: all further frames are exposed at or after `next`, or belong to its recorded set or later ones.
 * So close every set that none of them can join. */
void cap_assembler_close_before(cap_assembler *a, const struct cap_frame *next);
/* Next finished set or NULL. Caller owns it until cap_set_release. */
struct cap_set *cap_assembler_pop(cap_assembler *a);
/* Close everything (end of a replay). */
void cap_assembler_flush(cap_assembler *a);
uint32_t cap_assembler_open(const cap_assembler *a);        /* frames in open sets */
uint64_t cap_assembler_sets_failed(const cap_assembler *a); /* closed but not given out */
#endif
