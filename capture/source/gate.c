#include "capture/source/gate.h"

void cap_gate_init(struct cap_gate *g)
{
    *g = (struct cap_gate){.open = false};
    pthread_mutex_init(&g->lock, NULL);
    pthread_cond_init(&g->idle, NULL);
}

void cap_gate_fini(struct cap_gate *g)
{
    pthread_mutex_destroy(&g->lock);
    pthread_cond_destroy(&g->idle);
}

void cap_gate_open(struct cap_gate *g)
{
    pthread_mutex_lock(&g->lock);
    g->open = true;
    g->lost = false;
    pthread_mutex_unlock(&g->lock);
}

void cap_gate_shut(struct cap_gate *g)
{
    pthread_mutex_lock(&g->lock);
    g->open = false;
    while (g->busy > 0)
        pthread_cond_wait(&g->idle, &g->lock);
    pthread_mutex_unlock(&g->lock);
}

bool cap_gate_enter(struct cap_gate *g)
{
    pthread_mutex_lock(&g->lock);
    bool may = g->open;
    g->busy += may;
    pthread_mutex_unlock(&g->lock);
    return may;
}

void cap_gate_leave(struct cap_gate *g)
{
    pthread_mutex_lock(&g->lock);
    if (--g->busy == 0)
        pthread_cond_broadcast(&g->idle);
    pthread_mutex_unlock(&g->lock);
}

void cap_gate_lost(struct cap_gate *g, const struct cap_sink *sink, uint32_t camera)
{
    pthread_mutex_lock(&g->lock);
    bool tell = g->open && !g->lost;
    g->busy += tell;
    g->lost = true;
    pthread_mutex_unlock(&g->lock);
    if (!tell)
        return;
    sink->event(sink->ctx, camera, CAP_EV_LOST);
    cap_gate_leave(g);
}

bool cap_gate_is_lost(struct cap_gate *g)
{
    pthread_mutex_lock(&g->lock);
    bool lost = g->lost;
    pthread_mutex_unlock(&g->lock);
    return lost;
}
