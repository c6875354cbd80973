#include "daemon/pipeline/stage.h"

#include <stdio.h>

#include "base/clock.h"

static void *stage_run(void *arg)
{
    struct dmn_stage *s = arg;
    bool more = true;
    while (more) {
        more = s->step(s->ctx);
        atomic_store(&s->beat_ns, pvx_now_mono());
    }
    atomic_store(&s->done, true);
    return NULL;
}

pvx_err dmn_stage_start(struct dmn_stage *s, const char *name, bool (*step)(void *ctx), void *ctx)
{
    snprintf(s->name, sizeof s->name, "%s", name);
    s->step = step;
    s->ctx = ctx;
    atomic_store(&s->beat_ns, pvx_now_mono());
    if (pthread_create(&s->thread, NULL, stage_run, s) != 0)
        return PVX_EIO;
    s->started = true;
    pthread_setname_np(s->thread, s->name);
    return PVX_OK;
}

void dmn_stage_join(struct dmn_stage *s)
{
    if (s->started)
        pthread_join(s->thread, NULL);
    s->started = false;
}
