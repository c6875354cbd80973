/* stage.h - one stage of the pipeline: a named thread that repeats a step and shows that it lives.
 *
 * A step does one unit of work or waits for it, at most DMN_STAGE_WAIT_NS, so the heartbeat stands
 * still only when the stage is stuck.  Ownership: the struct is the caller's memory.
 * Threads: start and join from one thread; the heartbeat and the counters may be read by any. */
#ifndef DMN_STAGE_H
#define DMN_STAGE_H
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include "base/err.h"
#include "base/hist.h"

#define DMN_STAGE_WAIT_NS 100000000LL

struct dmn_stage {
    char name[16];
    bool (*step)(void *ctx); /* false = finished */
    void *ctx;
    pthread_t thread;
    bool started;
    atomic_bool done;
    _Atomic int64_t beat_ns; /* mono clock, after the last step */
    struct pvx_hist busy;    /* time per item; written by the stage alone */
};

/* Errors: PVX_EIO (no thread could be started). */
PVX_MUST_CHECK pvx_err dmn_stage_start(struct dmn_stage *s, const char *name,
                                       bool (*step)(void *ctx), void *ctx);
void dmn_stage_join(struct dmn_stage *s);
#endif
