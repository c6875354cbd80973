/* capture.h - all cameras of the rig, supervised: the interface for the daemon.
 *
 * One supervisor thread per camera opens it, starts it, triggers it, watches it and opens it again.  Software
 * triggers of all cameras lie on one grid of times and run in parallel, so that a camera that does not answer
 * delays no other.  A camera without a frame for max(0.7 s, 5 periods) is lost.  Its supervisor opens it again
 * after 0.25 s to 0.5 s, and the others go on.  One assembler thread maps clocks and groups frames.  Driver
 * callbacks push into a bounded ring per camera.  A full ring drops its oldest frame, which is counted.
 * Live: finished sets wait in a queue of two, which drops the oldest when the consumer is slow.
 * Lossless: frames are merged in order of exposure, and everything waits for the consumer.
 * After start the way of a frame allocates nothing (except in recorded sources: decoders do).
 * Invariant (tested), per camera and after stop: received == in sets given out + late + unmatched +
 * overflow (+ frames still on their way).
 * Threads: next() from one thread, stats() and stop() from any. */
#ifndef CAP_CAPTURE_H
#define CAP_CAPTURE_H
#include "base/hist.h"
#include "capture/sync/frameset.h"

#define CAP_ACTION_ADDRESSES 8
/* How action commands are sent (trigger.h). */
struct cap_action_config {
    struct cap_action_keys keys;
    /* Target addresses; IPv4, host order; none = the broadcast address of every network that has a camera. */
    uint32_t address[CAP_ACTION_ADDRESSES];
    size_t n_addresses;
    int64_t lead_ns;  /* > 0: scheduled, sent this much before the instant; 0 = acted on at once */
    bool acknowledge; /* cameras answer; a missing answer is counted */
};
struct cap_action_stats {
    uint64_t sent;   /* instants for which commands went out */
    uint64_t late;   /* scheduled instants left out: not enough of the lead was left */
    uint64_t failed; /* the host could not send to all networks */
};
struct cap_action_answers {
    uint64_t acknowledged, silent; /* the rest of `sent` was sent before the camera ran */
    uint64_t refused;              /* answered with an error, of these: */
    uint64_t too_late;             /* the instant had passed when the command came */
    uint64_t no_clock;             /* the camera's clock is not synchronized */
};

struct cap_capture_config {
    uint32_t n_cameras;
    /* [n_cameras]; .uri with its scheme ("aravis:127.0.0.2").  .camera, .trigger, .action and .lossless are filled
     * in here, .fps too if it is 0.  .buffers: at least 4 more than the sets that the consumer holds at a time;
     * 0 = 12.  Strings and features are copied; scene is borrowed. */
    const struct cap_source_config *camera;
    struct cap_assembler_params sets; /* .cameras is filled in, .period_ns too when it is 0 */
    double fps;                       /* nominal */
    enum cap_trigger trigger;         /* SOFTWARE: one sweep per period to all cameras */
    struct cap_action_config action;  /* ACTION: one broadcast per period and network */
    bool shared_clock;                /* device clocks are the host's (PTP, simulation): identity */
    bool lossless;                    /* replay: back-pressure instead of dropping */
    struct cap_tap tap;
    /* Sees each good frame before it is grouped, each camera's in order of exposure; or NULL.  Called by the assembler's
     * thread, so it must not wait. */
    void (*look)(void *ctx, const struct cap_frame *f);
    void *look_ctx;
    uint32_t discard_first; /* live frames per camera dropped after each start, uncounted
                                          (the first is often bad); 1 is a good value; cameras with
                                          clocks of their own: up to 8 in any case (intake.c) */
};

/* Histogram of skew: the exposure of a camera's frames minus the mean of their set.  Bin i holds
 * cap_skew_edges_ns[i-1] <= skew < cap_skew_edges_ns[i]; the first and the last bin are open.  The bins of the spread
 * of sets are the same, from 0 on. */
#define CAP_SKEW_BINS   29
#define CAP_SPREAD_BINS 15
extern const int64_t cap_skew_edges_ns[CAP_SKEW_BINS - 1];
struct cap_skew {
    uint64_t n;
    double mean_ns;
    int64_t p50_ns, p99_ns, max_ns; /* of the absolute value */
    uint64_t bin[CAP_SKEW_BINS];
};

/* A trouble of a camera, from its first occurrence until it has not occurred for a while. */
#define CAP_TROUBLES_MAX 6
struct cap_trouble {
    enum cap_count cause;
    uint64_t n; /* since it began, in the cause's unit */
    char detail[CAP_DETAIL_MAX];
};
/* What is wrong, and what to do about it; NULL for counts that are no trouble of their own. */
struct cap_trouble_def {
    const char *what, *remedy;
};
extern const struct cap_trouble_def cap_trouble_defs[CAP_N_COUNT];

enum cap_state { CAP_OPENING, CAP_RUNNING, CAP_LOST, CAP_ENDED };
struct cap_camera_stats {
    enum cap_state state;
    uint64_t count[CAP_N_COUNT];
    double fps; /* over the last 2 s */
    double drift_ppm;
    double
        clock_delay_us; /* least delay of its frames, found by reading its clock; NAN = not read */
    double hz, phase_us, walk_us_per_s; /* syncwatch.h; NAN = not known */
    struct cap_skew skew;
    uint32_t n_troubles;
    struct cap_trouble trouble[CAP_TROUBLES_MAX];
    char error[256];                  /* last reason it could not be opened, "" when fine */
    struct cap_health health;         /* as of a second ago at most; unknown when not running */
    struct cap_action_answers action; /* ACTION with acknowledge */
};
struct cap_stats {
    struct cap_camera_stats camera[CAP_MAX_CAMERAS];
    uint64_t sets_complete, sets_partial; /* assembled: with all cameras, with some */
    uint64_t sets_dropped;                /* of these, displaced because the consumer was slow */
    uint64_t sets_failed;                 /* closed with too few cameras, not given out */
    struct cap_action_stats action;
    struct pvx_hist spread;
    uint64_t spread_bin[CAP_SPREAD_BINS];
    uint64_t all_gone;    /* how often all cameras were lost at once */
    uint64_t host_steps;  /* how often the host's time of day was set by 2 ms or more */
    int64_t host_step_ns; /* the last of these */
};

typedef struct cap_capture cap_capture;
/* Errors: PVX_EINVAL (a value, an unknown scheme; diag names the camera), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_capture_new(const struct cap_capture_config *c, cap_capture **out,
                                       struct pvx_diag *d);
/* Returns at once, because each camera's thread opens it.  To be called only once. */
PVX_MUST_CHECK pvx_err cap_capture_start(cap_capture *c, struct pvx_diag *d);
/* The next set.  PVX_ETIMEDOUT; PVX_ECLOSED after stop, or when sources have ended, none is running any more and all
 * sets were given out. */
PVX_MUST_CHECK pvx_err cap_capture_next(cap_capture *c, int64_t timeout_ns, struct cap_set **out);
/* Returns when no thread uses the caller's data any more.  Exception: a driver stuck in its own call for over 3 s is
 * left behind (logged), and cleans up after itself when the call returns. */
void cap_capture_stop(cap_capture *c);
void cap_capture_free(cap_capture **c);
void cap_capture_stats(cap_capture *c, struct cap_stats *out);
/* What has been counted for one camera; from any thread, returns at once. */
void cap_capture_counts(const cap_capture *c, uint32_t camera, uint64_t out[CAP_N_COUNT]);
/* Health of one camera; from any thread, returns at once. */
void cap_capture_health(const cap_capture *c, uint32_t camera, struct cap_health *out);
#endif
