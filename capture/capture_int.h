/* capture_int.h - what capture.c, intake.c, supervisor.c and assembly.c share.
 *
 * Threads: driver threads of the sources (intake.c), a supervisor per camera (supervisor.c), the
 * assembler (assembly.c), the monitor (monitor.c), the consumer (capture.c).
 * Lock order: cap_capture.lock, then any of the leaf locks (buffer pool, set pool, set queue), which
 * take no further lock.  No call into a source is made under cap_capture.lock.
 * Stop order: flag and wake all; sources stopped and closed by their supervisors; supervisors
 * joined; assembler and monitor joined; rings and queue emptied.
 * Lifetime: the caller and each supervisor hold a reference, so a supervisor stuck in a driver can
 * be left behind. */
#ifndef CAP_CAPTURE_INT_H
#define CAP_CAPTURE_INT_H
#include <pthread.h>
#include "base/queue.h"
#include "capture/rig/capture.h"
#include "capture/clockmap.h"
#include "capture/sync/syncwatch.h"

#define CAP_FPS_BIN_NS 250000000LL
#define CAP_FPS_BINS   8 /* 2 s */
/* Frames that only tell the map of a clock what the least delay is, after a start or a jump. */
#define CAP_SETTLE_NS     (250 * PVX_NS_PER_MS)
#define CAP_SETTLE_FRAMES 8
#define CAP_READINGS      4

/* A trouble from its first occurrence until it has not been seen for a while (monitor.c). */
struct cap_episode {
    bool on;
    uint64_t seen;                     /* count at the last look */
    uint64_t begin;                    /* count before the first occurrence */
    int64_t begin_ns, last_ns, end_ns; /* mono */
    int64_t hold_ns;                   /* quiet time that ends it; grows when it comes back soon */
};

struct cap_skew_count {
    double sum_ns;
    struct pvx_hist abs;
    uint64_t bin[CAP_SKEW_BINS];
};

struct cap_camera {
    struct cap_capture *cap;
    /* fixed after new */
    uint32_t index;
    struct cap_source_config cfg;
    char *name, *uri; /* owned; uri with its scheme */
    char *line;       /* owned; cfg.trigger_line */
    struct cap_feature *features;
    const struct cap_source_ops *ops;
    int64_t quiet_ns; /* silence that counts as loss */
    bool shows_real;  /* its stamps are the host's time of day */

    /* under cap->lock */
    enum cap_state state;
    bool tried;      /* the first attempt to open and start is over */
    bool looked;     /* the first attempt to open is */
    bool delivering; /* good frames come: sets wait for it */
    bool given_up;   /* its first start failed: sets wait for its frames, not for it */
    bool ev_lost, ev_end;
    uint64_t count[CAP_N_COUNT];
    char error[256];
    int32_t width, height; /* what is expected; 0 = the first frame says */
    enum cap_pixfmt fmt;
    char detail[CAP_N_COUNT][CAP_DETAIL_MAX]; /* the last occurrence in a few words, or "" */
    unsigned still;                           /* frames in a row with the same stamp */
    bool restarted;                           /* for the assembler: a source has been started */
    struct cap_episode episode[CAP_N_COUNT];  /* the monitor's */
    struct cap_skew_count skew;
    int64_t last_any_mono_ns, last_good_mono_ns, last_device_ns;
    int64_t answered_mono_ns;     /* when a camera without frames was still there */
    bool no_trigger;              /* counted, until a frame comes */
    uint32_t discard, n_settling; /* frames after a start that are left out; so many there were */
    bool settled;
    int64_t settling_ns; /* arrival of the first of them */
    struct {
        int64_t slot;
        uint32_t n;
    } bin[CAP_FPS_BINS + 1];
    int64_t first_slot; /* of this run */
    struct cap_frame **ring;
    size_t ring_size, ring_head, ring_len;
    double drift_ppm;
    struct cap_health health;
    struct cap_action_answers action;
    bool done;           /* supervisor has finished */
    pthread_cond_t wake; /* supervisor: event or stop */
    pthread_cond_t room; /* lossless push: ring has room, or stop */

    struct { /* of its clock, for the assembler; the newest when there is no room */
        int64_t device_ns, mono_ns, bound_ns;
    } reading[CAP_READINGS];
    unsigned n_readings;

    /* the assembler's */
    struct cap_clockmap clock;
    unsigned unsure_left; /* after a jump: frames, until unsure_until_ns, that are not matched */
    int64_t unsure_until_ns;
    struct cap_frame *head; /* lossless: next frame in order of time */

    pthread_t thread;
    bool started; /* thread exists */
};

/* CLOCK_REALTIME - CLOCK_MONOTONIC, which changes when the time of day is set. */
struct cap_host_clock {
    bool known;
    int64_t offset_ns;
    int64_t doubt_ns; /* what the last frames say instead */
    unsigned n_doubts;
    uint64_t steps;
    int64_t last_step_ns;
};

struct cap_capture {
    struct cap_capture_config cfg;
    int64_t period_ns; /* 0 = unknown */
    uint32_t n;
    struct cap_camera *camera;
    int64_t started_mono_ns;
    cap_assembler *assembler; /* the assembler thread's */
    pvx_queue *out;
    pthread_t assembler_thread, monitor_thread;
    bool assembler_started, monitor_started;
    bool watches;               /* live: cameras are compared */
    struct cap_syncwatch watch; /* the assembler's, under the lock */
    bool all_show_real;
    pthread_t trigger_thread;
    bool trigger_started;
    /* why the next frame that the assembler gives up is in no set; its thread's */
    enum cap_count stray;

    pthread_mutex_t lock;
    pthread_cond_t work;    /* assembler: a frame, a camera's state, or stop */
    pthread_cond_t changed; /* stop: a supervisor is done, or stop is over */
    unsigned refs;
    bool started, stop, stopped;
    uint64_t sets_complete, sets_partial, sets_dropped, sets_failed;
    struct cap_action_stats action;
    struct pvx_hist spread;
    uint64_t spread_bin[CAP_SPREAD_BINS];
    pthread_cond_t ending; /* monitor: stop */
    struct cap_episode bandwidth, all_gone, ptp_masters;
    uint64_t times_all_gone;
    struct cap_host_clock host;
};

/* intake.c: the sink that sources push into; ctx is the camera. */
struct cap_sink cap_intake_sink(struct cap_camera *cam);
/* Make ready for frames of a source that is about to start.  Under the lock. */
void cap_intake_restart(struct cap_camera *cam);
/* Oldest frame of the ring, not empty.  Under the lock. */
struct cap_frame *cap_intake_pop(struct cap_camera *cam);

void *cap_supervise(void *camera); /* thread, supervisor.c */
void *cap_assemble(void *capture); /* thread, assembly.c: the next until there is none */
/* One frame, or, with none there and `wait`, until something happens; false: it was the last.  Its
 * thread's, and of tests that have time stand still. */
bool cap_assemble_some(struct cap_capture *cap, bool wait);
void *cap_monitor(void *capture); /* thread, monitor.c: logs what goes wrong, once */
/* A camera's troubles that are on, for stats.  Under the lock. */
void cap_monitor_troubles(const struct cap_camera *cam, struct cap_camera_stats *out);

/* Wait on a condition of CLOCK_MONOTONIC under the lock until `mono_ns` at most. */
void cap_wait_until(pthread_cond_t *cond, pthread_mutex_t *lock, int64_t mono_ns);
void cap_capture_unref(struct cap_capture *c);
#endif
