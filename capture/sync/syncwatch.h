/* syncwatch.h - what exposure times and frame numbers tell about how well cameras work together.
 *
 * Matching by time (frameset.h) never mixes instants, but it cannot know that a camera is in the wrong
 * mode; frame numbers can, and so can rates and phases.  Per camera, each in its count of
 * source.h and with numbers for a message:
 *
 * SLIP, MISSED_TRIGGER.  Sets are numbered by their instants: K = what most members' frame numbers say,
 * each id plus an offset learnt at its first set; where there is no majority, what the time says.  A
 * member that says otherwise, in two sets in a row: if it has numbered fewer pictures than there were
 * instants, and it was away for as many, it has missed triggers (there is no gap in its numbers);
 * everything else is a slip: its numbers and its times disagree, and its pictures may be one instant
 * off.  Found with the second set.  What cannot be told: a camera without a common clock or readings of
 * its clock, whose pictures have all been late by one period since its start; time stamps and numbers
 * then agree.
 *
 * OUT_OF_STEP.  Phase = its exposure minus the others' last, modulo the period; median over the others;
 * mean over windows of max(0.5 s, 8 periods).  Outside the tolerance, or a clock that is off by more than
 * four periods against the order of arrival.  Found after one to two windows, so within
 * a second at 16 Hz and above.
 *
 * PHASE_WALK.  The phase moves steadily: line through the last windows, 4 to 128 of them, that has
 * changed by more than max(period / 20, 0.5 ms) and what the clocks' maps may be off by, and by 6 times
 * its own scatter; or, once maps are known, by 0.5 ms and that, 8 times its scatter (a step is no walk) and
 * surely (syncrate.h).  While a map is being learnt, only what moves by more than 0.6 ms per second counts.
 * So a camera that runs by itself beside triggered ones is found before it is out of step: after 5 s at
 * 200 ppm, 12 s at 50 ppm (known clocks, stamps good to 0.2 ms, 30 Hz); there is nothing to see much
 * earlier.
 *
 * RATE.  Over a window: frames by number against the nominal rate, off by 30 %; or periods by rounded
 * interval, off by 1 %; found after one to two windows.  Against the median of the other cameras, on
 * each one's own clock: off by more than 400 ppm, surely (syncrate.h): below that it is clocks.  So a camera
 * that runs freely at 1000 ppm, or at 29.97 Hz beside 30, is found after 0.5 s with stamps good to some
 * microseconds, after 1.4 s with 0.2 ms, 3.5 s with 1 ms.  Stamps that a driver makes on the host wander
 * with its load: they are judged over 10 s only.  Counted once a window.
 *
 * With two cameras nobody knows which of them is wrong; both are named (RATE: the one farther from
 * nominal).
 * The last three count the windows in which it was so.
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
        double doubt_ns; /* in: its mapped times may wander by it; infinite: drift not known well */
        bool host_stamps; /* in: a driver stamps its frames with the host's clock */
        uint64_t id;
        int64_t t_ns, arrival_ns;
        /* numbers against sets */
        bool numbered;
        int64_t offset;       /* instant - id */
        int64_t last_instant; /* that it was a member of */
        int64_t doubt;        /* instants that it disagreed by in the last set */
        int64_t away;         /* instants without it, before it disagreed */
        /* window: t0 .. t0 + window */
        int64_t t0;
        uint64_t id0, frames, far; /* far: its clock is nowhere near the others' */
        int64_t periods;           /* rounded intervals; -1: one was no multiple */
        double cos, sin;           /* of the phase */
        unsigned phases;
        int64_t far_ns;
        /* windows gone by */
        struct {
            int64_t t_ns;
            double phase_ns; /* unwrapped */
        } walk[CAP_WALK_WINDOWS];
        unsigned n_walk, walk_head, n_sure; /* sure: in a row, no map was being learnt */
        struct cap_rate rate;
        bool rate_by_host;        /* its stamps are the host's */
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
/* Every good frame, its exposure mapped, in order of arrival. */
void cap_syncwatch_frame(struct cap_syncwatch *w, const struct cap_frame *f);
/* Every set given out. */
void cap_syncwatch_set(struct cap_syncwatch *w, const struct cap_set *s);
/* The camera was started anew, or its clock jumped: nothing of before counts. */
void cap_syncwatch_restart(struct cap_syncwatch *w, uint32_t camera);
/* The clock of the exposure times was stepped. */
void cap_syncwatch_shift(struct cap_syncwatch *w, int64_t by_ns);

#endif
