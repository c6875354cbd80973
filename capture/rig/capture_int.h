/* capture_int.h - shared by the files of this room: a camera in three parts, each with one owner.
 *
 *     intake     the thread of the source that pushes; the supervisor's while no source runs  intake.c
 *     life       the camera's supervisor                                                      supervisor.c
 *     assembly   the assembler's thread                                                       assembly.c
 * Other threads read a part through atomics or a board (base/board.h: the reader retries, the writer never
 * waits).  Frames go from intake to assembly through a ring of one producer (base/ring.h).  Any thread may add
 * to counts.  A thread that pushes takes no lock (it only tries one), and waits only for room in a lossless run.
 *
 * Locks.  No thread takes one while it holds another, or calls a source while it holds one:
 *     cap_capture.figures   the assembler, while it changes what stats() and the monitor copy of it
 *     cap_readings.lock     readings of a camera's clock, from its source to the assembler; copies only
 *     of other modules      buffer pool, set pool, set queue; they take no further lock
 * Exception: stop() alone takes cap_capture.stopping, as its first lock, and holds it while it joins.
 * Threads beside those above: the monitor (monitor.c), the one that triggers (trigger.c), the consumer.
 * Stop order: flag and bells; sources stopped and closed by their supervisors; supervisors joined;
 * assembler and monitor joined; rings and queue emptied.
 * Lifetime: the caller and each supervisor hold a reference, so a supervisor stuck in a driver can be
 * left behind. */
#ifndef CAP_CAPTURE_INT_H
#define CAP_CAPTURE_INT_H
#include <pthread.h>
#include <stdatomic.h>
#include "base/bell.h"
#include "base/board.h"
#include "base/queue.h"
#include "base/ring.h"
#include "capture/rig/capture.h"
#include "capture/sync/clockmap.h"
#include "capture/sync/syncwatch.h"

#define CAP_FPS_BIN_NS 250000000LL
#define CAP_FPS_BINS   8 /* 2 s */
/* After a start or a jump, frames within this time, at most this many, only teach the clock's map the least delay. */
#define CAP_SETTLE_NS     (250 * PVX_NS_PER_MS)
#define CAP_SETTLE_FRAMES 8
#define CAP_READINGS      32

struct cap_intake {
    /* expected of frames; 0 = as in the first frame */
    int32_t width, height;
    enum cap_pixfmt fmt;
    int64_t last_device_ns;
    unsigned still;               /* frames in a row with the same stamp */
    uint32_t discard, n_settling; /* frames to leave out after a start; frames since the start */
    bool settled;
    int64_t settling_ns; /* arrival of the first frame after the start */
    /* read by others */
    pvx_ring *ring;
    struct pvx_bell room;                   /* lossless: the ring has room, or stop */
    _Atomic int64_t any_ns, good_ns;        /* mono: when the last frame came, the last good one */
    _Atomic int64_t first_slot;             /* of this run */
    _Atomic uint64_t bin[CAP_FPS_BINS + 1]; /* good frames of a slot: slot << 24 | frames */
    atomic_uint starts;
    atomic_bool lost, ended; /* reported by the source */
};

struct cap_life {
    pthread_t thread;
    bool started; /* thread exists */
    struct pvx_bell wake;
    /* read by others */
    _Atomic(enum cap_state) state;
    atomic_bool tried;          /* the first attempt to open and start is over */
    atomic_bool looked;         /* the first attempt to open is over */
    atomic_bool given_up;       /* its first start failed: sets wait for it only once frames come */
    atomic_bool done;           /* the supervisor has finished */
    _Atomic uint64_t silent_at; /* CAP_RECEIVED when it was found to give no more good frames */
    struct pvx_board error;     /* char [] */
    struct pvx_board health;    /* struct cap_health */
};

struct cap_skew_count {
    double sum_ns;
    struct pvx_hist abs;
    uint64_t bin[CAP_SKEW_BINS];
};

struct cap_assembly {
    struct cap_frame *head; /* next frame of the camera, taken out of the ring */
    unsigned unsure_left;   /* after a jump: frames, until unsure_until_ns, that are not matched */
    int64_t unsure_until_ns;
    unsigned starts; /* starts of the source that the assembler has seen */
    /* changed under figures */
    struct cap_clockmap clock;
    struct cap_skew_count skew;
};

/* Readings of a camera's clock, kept until a frame is mapped.  Without room, the newest replaces the last. */
struct cap_readings {
    pthread_mutex_t lock;
    unsigned n;
    struct cap_reading {
        int64_t device_ns, mono_ns;
        int64_t bound_ns; /* < 0: stamp and arrival of a frame that was left out */
    } reading[CAP_READINGS];
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
    bool own_clock;   /* its stamps are mapped */

    struct cap_intake intake;
    struct cap_life life;
    struct cap_assembly assembly;
    struct cap_readings readings;

    _Atomic uint64_t count[CAP_N_COUNT];
    struct pvx_board detail[CAP_N_COUNT];  /* char []: last occurrence; written by its finder */
    _Atomic uint64_t trouble[CAP_N_COUNT]; /* by the monitor: count before it began + 1; 0 = none */
    struct pvx_board answers; /* struct cap_action_answers; written by the thread that triggers */
};

/* CLOCK_REALTIME - CLOCK_MONOTONIC, which changes when the time of day is set. */
struct cap_host_clock {
    bool known;
    int64_t offset_ns;
    int64_t doubt_ns; /* another offset that the last frames show */
    unsigned n_doubts;
    uint64_t steps;
    int64_t last_step_ns;
    int64_t since_ns; /* mono: arrival of the frame that showed the last step */
};

struct cap_capture {
    /* fixed after new */
    struct cap_capture_config cfg;
    int64_t period_ns; /* 0 = unknown */
    uint32_t n;
    struct cap_camera *camera;
    bool watches; /* live: cameras are compared */
    bool all_show_real;

    int64_t started_mono_ns;
    pvx_queue *out;
    pthread_t assembler_thread, monitor_thread, trigger_thread;
    bool started, assembler_started, monitor_started, trigger_started;
    atomic_uint refs;
    pthread_mutex_t stopping;
    atomic_bool stop;
    struct pvx_bell work;   /* assembler: a frame, a camera's state, or stop */
    struct pvx_bell home;   /* stop: a supervisor is done */
    struct pvx_bell ending; /* monitor: stop */

    /* the assembler's */
    cap_assembler *assembler;
    enum cap_count stray;    /* why the next frame that the assembler pushes is in no set */
    pthread_mutex_t figures; /* and changed under it: */
    struct cap_syncwatch watch;
    struct cap_host_clock host;
    uint64_t sets_complete, sets_partial, sets_dropped, sets_failed;
    struct pvx_hist spread;
    uint64_t spread_bin[CAP_SPREAD_BINS];

    struct pvx_board action;         /* struct cap_action_stats; by the thread that triggers */
    _Atomic uint64_t times_all_gone; /* written by the monitor */
};

/* setup.c: everything but the threads, from cap->cfg. */
pvx_err cap_set_up(struct cap_capture *cap, struct pvx_diag *d);

/* intake.c: the sink that sources push into; ctx is the camera. */
struct cap_sink cap_intake_sink(struct cap_camera *cam);
/* Prepare for the frames of a source that is about to start. */
void cap_intake_restart(struct cap_camera *cam);
/* Oldest frame of the ring, or NULL. */
struct cap_frame *cap_intake_pop(struct cap_camera *cam);
double cap_intake_fps(const struct cap_camera *cam, int64_t now);
/* Describe the next count. */
__attribute__((format(printf, 3, 4))) void cap_detail(struct cap_camera *cam, enum cap_count what,
                                                      const char *format, ...);
/* Whether good frames come, so that sets wait for the camera. */
static inline bool cap_delivers(const struct cap_camera *cam)
{
    return cam->count[CAP_RECEIVED] != cam->life.silent_at;
}

void *cap_supervise(void *camera); /* thread, supervisor.c */
void *cap_assemble(void *capture); /* thread, assembly.c: frames until there are no more */
/* Assemble one frame.  If there is none and `wait`, wait until something happens.  False: no more frames will come.
 * For the assembler's thread, and for tests in which time stands still. */
bool cap_assemble_some(struct cap_capture *cap, bool wait);
/* Release the frames that are still in the rings.  Only while no assembler runs. */
void cap_assemble_nothing(struct cap_capture *cap);
void *cap_monitor(void *capture); /* thread, monitor.c: logs what goes wrong, once */

void cap_capture_unref(struct cap_capture *c);
#endif
