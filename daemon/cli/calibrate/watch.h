/* watch.h - what the threads of `calibrate live` share.
 *
 * Main thread: takes frame sets from capture, hands the newest to the watcher, and draws.  A set that still waits for
 * the watcher is replaced and counted.  Watcher (watch.c): finds the board in every picture of the set, on as many
 * threads as --threads says.  When the board stands still in a new pose, it saves the pictures.  Solver (resolve.c):
 * solves again whenever there are more pictures.  So no thread waits for slow work, least of all capture.
 * `lock` guards everything below it.  Pictures are only added and never changed, so borrowed corners stay valid after
 * the lock is released.  Pictures are in the order of their numbers. */
#ifndef CALIBRATE_WATCH_H
#define CALIBRATE_WATCH_H
#include <pthread.h>

#include "daemon/cli/calibrate/cameras.h"
#include "daemon/cli/calibrate/job.h"
#include "daemon/cli/calibrate/still.h"
#include "recon/calib/next.h"

#define LIVE_PLACES 48 /* 8 x 6 over the picture */

/* A camera's latest picture, and all pictures taken of it so far. */
struct live_camera {
    bool seen, running;
    enum rec_sight outcome;
    size_t corners;
    double blur;            /* px */
    double bright, clipped; /* shares of full scale: 99th percentile; of pixels */
    double fps;
    char error[256];
    size_t boards;   /* taken with the board in it */
    uint64_t places; /* bits: where corners were */
};

enum live_now {
    LIVE_OPENING, /* cameras do not deliver yet */
    LIVE_UNSEEN,  /* no camera sees the board */
    LIVE_MOVING,
    LIVE_STILL,   /* but not for long enough */
    LIVE_ALONE,   /* the first pose needs two cameras that see the board */
    LIVE_MISSING, /* a camera that runs is not in the set */
    LIVE_KNOWN,   /* this pose was taken before */
    LIVE_TAKEN
};

/* The last solve.  It is of the largest group of cameras that poses join. */
struct live_result {
    bool there;
    pvx_err e;
    struct pvx_diag d; /* why it failed */
    size_t n, poses;
    uint32_t of[REC_MAX_CAMERAS]; /* [n] camera of the rig -> camera of `look` */
    struct rec_rig rig;
    struct rec_calib_report report;
    struct rec_calib_next next; /* text "": none helps */
    double seconds;
};

struct live {
    const struct calibrate_args *a;
    const char *frames;
    struct calibrate_cameras cams;
    uint32_t look_of[REC_MAX_CAMERAS]; /* camera of capture -> camera of job.look */
    pvx_pool *pool;
    struct live_eye *eye; /* [n] the watcher's own */
    cap_capture *capture;
    pthread_t watcher, solver;
    bool started;

    pthread_mutex_t lock;
    pthread_cond_t wake; /* the inbox, taken, stop */
    bool stop;
    pvx_err e; /* the watcher or the solver cannot go on */
    struct pvx_diag d;
    struct calibrate_job job; /* .look: the pictures */
    struct cap_set *inbox;
    uint64_t looks, skipped, dropped; /* sets: looked at, replaced here, replaced in capture */
    enum live_now now;
    uint32_t missing;    /* LIVE_MISSING: camera of look */
    uint32_t next_frame; /* number */
    size_t poses;        /* taken, with the board in at least one picture */
    size_t taken_now;    /* since this start */
    uint32_t last;       /* number of the last */
    uint32_t *common;    /* [n][n] poses that both saw */
    struct live_camera camera[REC_MAX_CAMERAS];
    struct live_result result;
};

/* Start the threads; stop joins the started ones.  Set before: a, frames, cams, look_of, pool, job, lock, wake. */
PVX_MUST_CHECK pvx_err live_start(struct live *l, struct pvx_diag *d);
void live_stop(struct live *l);
/* Hand the newest set to the watcher.  Takes the reference. */
void live_offer(struct live *l, struct cap_set *s);
/* Compute the counts anew from all pictures. */
void live_count(struct live *l);

void *live_solve(void *ctx); /* resolve.c: the solver's thread */

#endif
