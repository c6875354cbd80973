#include "capture/source/player.h"

#include <stdio.h>

#include "base/clock.h"

#define FRAMES_MIN 4

void cap_player_init(struct cap_player *p, const struct cap_source_config *c, clockid_t clock)
{
    *p = (struct cap_player){.camera = c->camera, .lossless = c->lossless, .clock = clock};
    pthread_mutex_init(&p->lock, NULL);
    pvx_cond_init(&p->wake, clock);
}

pvx_err cap_player_make_pool(struct cap_player *p, const struct cap_source_config *c, size_t bytes)
{
    unsigned n = c->buffers < FRAMES_MIN ? FRAMES_MIN : c->buffers;
    return cap_bufpool_of(c, n, bytes, &p->pool);
}

pvx_err cap_player_start(struct cap_player *p, const char *scheme, const struct cap_sink *sink,
                         void *(*run)(void *arg), void *arg, struct pvx_diag *d)
{
    p->sink = *sink;
    p->stop = false;
    cap_bufpool_resume(p->pool);
    if (pthread_create(&p->thread, NULL, run, arg) != 0)
        return pvx_fail(d, PVX_EIO, "%s: cannot start a thread", scheme);
    char name[16];
    snprintf(name, sizeof name, "%s%u", scheme, p->camera);
    pthread_setname_np(p->thread, name);
    p->running = true;
    return PVX_OK;
}

void cap_player_stop(struct cap_player *p)
{
    if (!p->running)
        return;
    pthread_mutex_lock(&p->lock);
    p->stop = true;
    pthread_cond_broadcast(&p->wake);
    pthread_mutex_unlock(&p->lock);
    cap_bufpool_cancel(p->pool);
    pthread_join(p->thread, NULL);
    p->running = false;
}

void cap_player_fini(struct cap_player *p)
{
    cap_bufpool_unref(&p->pool);
    pthread_mutex_destroy(&p->lock);
    pthread_cond_destroy(&p->wake);
}

bool cap_player_stopped(struct cap_player *p)
{
    pthread_mutex_lock(&p->lock);
    bool stop = p->stop;
    pthread_mutex_unlock(&p->lock);
    return stop;
}

static int64_t player_now(const struct cap_player *p)
{
    return p->clock == CLOCK_REALTIME ? pvx_now_real() : pvx_now_mono();
}

bool cap_player_wait_until(struct cap_player *p, int64_t t)
{
    struct timespec ts = {.tv_sec = t / PVX_NS_PER_S, .tv_nsec = t % PVX_NS_PER_S};
    pthread_mutex_lock(&p->lock);
    while (!p->stop && player_now(p) < t)
        pthread_cond_timedwait(&p->wake, &p->lock, &ts);
    bool go = !p->stop;
    pthread_mutex_unlock(&p->lock);
    return go;
}

struct cap_frame *cap_player_get(struct cap_player *p)
{
    if (p->lossless)
        return cap_bufpool_get_wait(p->pool);
    struct cap_frame *f = cap_bufpool_get(p->pool);
    if (f == NULL)
        cap_player_count(p, CAP_UNDERRUN, 1);
    return f;
}

void cap_player_count(struct cap_player *p, enum cap_count what, uint64_t n)
{
    if (n > 0)
        p->sink.count(p->sink.ctx, p->camera, what, n);
}

void cap_player_event(struct cap_player *p, enum cap_event ev)
{
    p->sink.event(p->sink.ctx, p->camera, ev);
}
