/* compute.h - where frame sets are solved: on the processors, or on a graphics card.
 *
 * dmn_compute_open finds the device and refuses what cannot be, before anything that takes long.
 * dmn_compute_choose, with the matrix, measures whether a card is faster, where that decides (auto).
 * Threads: one.  Owner: caller; the device has to outlive all frames that use it. */
#ifndef DMN_COMPUTE_DEVICE_H
#define DMN_COMPUTE_DEVICE_H
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include "daemon/control/state.h"
#include "recon/frame/frame.h"
#include "recon/opencl/device.h"

#define DMN_COMPUTE_SETS 8 /* that are measured at most, of each */

struct dmn_compute_want {
    const char *word;    /* of daemon/config/compute.h */
    const char *what;    /* what messages call it: "my.yaml: compute" */
    const char *refused; /* what else was asked for that only the processors do; NULL: nothing */
};
struct dmn_compute {
    rec_cl *card;            /* NULL: the processors */
    bool measure;            /* dmn_compute_choose decides */
    bool warn;               /* what is said is a warning: a device that was asked for fails */
    char said[PVX_DIAG_MAX]; /* one sentence for the user; "": nothing to say */
};
/* A device that is there but fails is no error: the daemon has to start.  Errors, with `opencl` alone: PVX_EINVAL
 * (refused), PVX_ENOENT and PVX_EUNSUP of rec_cl_open. */
PVX_MUST_CHECK pvx_err dmn_compute_open(const struct dmn_compute_want *w, struct dmn_compute *out,
                                        struct pvx_diag *d);
void dmn_compute_close(struct dmn_compute *c);
/* The last call of a program, with its exit code.  It does not return where the driver of a device that hangs would keep
 * the program from ending. */
int dmn_compute_leave(int code);

struct dmn_compute_job { /* borrowed */
    const rec_sysmat *S;
    const struct rec_rig *rig;
    pvx_pool *pool;
    float *const *background; /* as for dmn_pipeline_params */
    /* Fills the slot with set k, 0..DMN_COMPUTE_SETS-1; NULL: a flame that the rig would see. */
    void (*load)(void *ctx, size_t k, rec_frame *f);
    void *ctx;
};
/* Sets p->card, and measures first if that decides.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_compute_choose(struct dmn_compute *c, const struct dmn_compute_job *job,
                                          struct rec_frame_params *p, struct pvx_diag *d);

/* Of the sets of a pipeline.  One thread notes them, any may ask. */
struct dmn_compute_count {
    atomic_uint_fast64_t there, raw, here; /* state.h */
    pthread_mutex_t lock;                  /* of `why`; held only to copy */
    char why[128];                         /* the last reason; a new one is logged */
};
/* A solved set; card NULL: nothing. */
void dmn_compute_note(struct dmn_compute_count *c, const struct rec_cl *card,
                      const struct rec_frame_report *r);
/* The card cannot do what is asked of it from now on. */
void dmn_compute_fail(struct dmn_compute_count *c, const struct rec_cl *card, const char *why);
void dmn_compute_state(struct dmn_compute_count *c, const struct rec_cl *card,
                       struct dmn_compute_state *out);
#endif
