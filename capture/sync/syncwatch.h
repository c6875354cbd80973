/* syncwatch.h - finds faults of synchronization in exposure times and frame numbers.
 *
 * Matching by time (frameset.h) never mixes instants, but it does not notice a camera in the wrong mode.  Frame
 * numbers, rates and phases show that.  Each fault has a count of source.h per camera, and numbers for a message:
 *
 *     SLIP, MISSED_TRIGGER   frame number + an offset learnt = number of the instant, by most members (1)
 *     OUT_OF_STEP            |phase| <= tolerance; phase = exposure - the others' last, modulo the
 *                            period: median over them, mean over a window of max(0.5 s, 8 periods)  (2)
 *     PHASE_WALK             phase = constant: line through 4 to 128 windows                        (3)
 *     RATE                   frames a second = nominal to 1 %, and = the others' to 400 ppm (syncrate.h)
 *
 * The last three count the windows in which the condition failed.  Two cameras do not show which of them is wrong,
 * so both are named (RATE: the one farther from nominal).  SYNC.md section 10 has bounds, detection times, and
 * the faults that cannot be found.
 * Threads: one (the assembler's).  Allocates nothing; cost O(cameras) per frame, O(cameras^2) per set. */
#ifndef CAP_SYNCWATCH_H
#define CAP_SYNCWATCH_H
#include "capture/sync/frameset.h"
#include "capture/sync/syncrate.h"

#define CAP_WALK_WINDOWS 128

struct cap_syncwatch_params {
    uint32_t cameras;
    int64_t period_ns; /* 0 = not known: no phases, no rates */
    int64_t tolerance_ns;
    bool paced_outside; /* triggers come from elsewhere: the nominal rate is only a rough guess */
};

struct cap_syncwatch {
    struct cap_syncwatch_params p;
    struct cap_sink counts; /* only ->count is called */
    void (*detail)(void *ctx, uint32_t camera, enum cap_count what, const char *text);
    int64_t window_ns;
    bool any_set;
    int64_t instant, t_set_ns; /* number and time of the last set */
    struct cap_sync_camera {
        /* last frame */
        bool any;
        double doubt_ns; /* in: its mapped times may move by this; infinite: drift not known well */
        bool host_stamps; /* in: a driver stamps its frames with the host's clock */
        uint64_t id;
        int64_t t_ns, arrival_ns;
        /* numbers against sets */
        bool numbered;
        int64_t offset;       /* instant - id */
        int64_t last_instant; /* last instant that it was a member of */
        int64_t doubt;        /* its disagreement in the last set, in instants */
        int64_t away;         /* instants without it, before it disagreed */
        /* window: t0 .. t0 + window */
        int64_t t0;
        uint64_t id0, frames, far; /* far: frames whose time was far from the others' */
        int64_t periods;           /* sum of rounded intervals; -1: one was not a multiple */
        double cos, sin;           /* of the phase */
        unsigned phases;
        int64_t far_ns;
        /* past windows */
        struct {
            int64_t t_ns;
            double phase_ns; /* unwrapped */
        } walk[CAP_WALK_WINDOWS];
        unsigned n_walk, walk_head, n_sure; /* sure: windows in a row with all maps known */
        struct cap_rate rate;
        bool rate_by_host;        /* the rate's stamps are the host's */
        int64_t rate_odd_mono_ns; /* when its rate was last found odd, by arrival; 0 = never */
        /* for a report; NAN = not known */
        double phase_ns, walk_ns_per_s, hz;
    } camera[CAP_MAX_CAMERAS];
};

/* detail may be NULL. */
void cap_syncwatch_init(struct cap_syncwatch *w, const struct cap_syncwatch_params *p,
                        const struct cap_sink *counts,
                        void (*detail)(void *ctx, uint32_t camera, enum cap_count what,
                                       const char *text));
/* To be called for every good frame with a mapped exposure time, in order of arrival. */
void cap_syncwatch_frame(struct cap_syncwatch *w, const struct cap_frame *f);
/* To be called for every set given out. */
void cap_syncwatch_set(struct cap_syncwatch *w, const struct cap_set *s);
/* The camera was started again, or its clock jumped: its past no longer counts. */
void cap_syncwatch_restart(struct cap_syncwatch *w, uint32_t camera);
/* The clock of the exposure times was stepped. */
void cap_syncwatch_shift(struct cap_syncwatch *w, int64_t by_ns);

#endif
