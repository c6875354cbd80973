#include "capture/source/lend.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>

#include "base/mem.h"

struct slot {
    struct cap_frame frame; /* first: a frame's address is its slot's */
    struct cap_lend *lend;
    bool out;     /* with the consumer */
    bool refused; /* the driver did not take it back */
};

struct cap_lend {
    pthread_mutex_t lock;
    struct cap_lend_ops ops;
    void *ctx;
    unsigned n, spare, n_out, n_refused;
    uint32_t camera;
    bool running, closed;
    struct slot *slot; /* [n] */
};

static void lend_end(cap_lend *l)
{
    l->ops.destroy(l->ctx);
    pthread_mutex_destroy(&l->lock);
    free(l->slot);
    free(l);
}

/* Under the lock. */
static void lend_requeue(cap_lend *l, struct slot *s)
{
    if (!l->running)
        return;
    bool refused = !l->ops.requeue(l->ctx, (unsigned)(s - l->slot));
    l->n_refused += refused;
    l->n_refused -= s->refused;
    s->refused = refused;
}

/* Under the lock. */
static void lend_unused(cap_lend *l, const struct slot *s)
{
    if (l->closed && !s->out && l->ops.unused != NULL)
        l->ops.unused(l->ctx, (unsigned)(s - l->slot));
}

static void lend_release(struct cap_frame *f)
{
    struct slot *s = (struct slot *)f;
    cap_lend *l = s->lend;
    pthread_mutex_lock(&l->lock);
    s->out = false;
    l->n_out--;
    lend_requeue(l, s);
    lend_unused(l, s);
    bool last = l->closed && l->n_out == 0;
    pthread_mutex_unlock(&l->lock);
    if (last)
        lend_end(l);
}

pvx_err cap_lend_new(unsigned n, unsigned spare, uint32_t camera, const struct cap_lend_ops *ops,
                     void *ctx, cap_lend **out)
{
    *out = NULL;
    if (n < 1 || n > CAP_BUFFERS_MAX + spare || spare >= n)
        return PVX_EINVAL;
    cap_lend *l = pvx_calloc(1, sizeof *l);
    PVX_NEED(l);
    l->slot = pvx_calloc(n, sizeof *l->slot);
    if (l->slot == NULL) {
        free(l);
        return PVX_ENOMEM;
    }
    pthread_mutex_init(&l->lock, NULL);
    l->ops = *ops;
    l->ctx = ctx;
    l->n = n;
    l->spare = spare;
    l->camera = camera;
    for (unsigned i = 0; i < n; i++)
        l->slot[i].lend = l;
    *out = l;
    return PVX_OK;
}

void cap_lend_run(cap_lend *l, bool on)
{
    pthread_mutex_lock(&l->lock);
    l->running = on;
    l->n_refused = 0;
    for (unsigned i = 0; i < l->n; i++)
        l->slot[i].refused = false;
    for (unsigned i = 0; on && i < l->n; i++)
        if (!l->slot[i].out)
            lend_requeue(l, &l->slot[i]);
    pthread_mutex_unlock(&l->lock);
}

struct cap_frame *cap_lend_out(cap_lend *l, unsigned index)
{
    struct slot *s = &l->slot[index];
    pthread_mutex_lock(&l->lock);
    bool may = l->n - l->n_refused - l->n_out > l->spare && !s->out;
    if (may) {
        s->out = true;
        l->n_out++;
    }
    pthread_mutex_unlock(&l->lock);
    if (!may)
        return NULL;
    s->frame = (struct cap_frame){
        .camera = l->camera, .exposure_us = NAN, .gain = NAN, .release = lend_release, .owner = l};
    return &s->frame;
}

void cap_lend_back(cap_lend *l, unsigned index)
{
    pthread_mutex_lock(&l->lock);
    if (!l->slot[index].out)
        lend_requeue(l, &l->slot[index]);
    pthread_mutex_unlock(&l->lock);
}

unsigned cap_lend_retry(cap_lend *l)
{
    pthread_mutex_lock(&l->lock);
    for (unsigned i = 0; l->n_refused > 0 && i < l->n; i++)
        if (l->slot[i].refused)
            lend_requeue(l, &l->slot[i]);
    unsigned n = l->n_refused;
    pthread_mutex_unlock(&l->lock);
    return n;
}

unsigned cap_lend_n_out(cap_lend *l)
{
    pthread_mutex_lock(&l->lock);
    unsigned n = l->n_out;
    pthread_mutex_unlock(&l->lock);
    return n;
}

void cap_lend_close(cap_lend **lp)
{
    cap_lend *l = *lp;
    if (l == NULL)
        return;
    *lp = NULL;
    pthread_mutex_lock(&l->lock);
    l->running = false;
    l->closed = true;
    for (unsigned i = 0; i < l->n; i++)
        lend_unused(l, &l->slot[i]);
    bool last = l->n_out == 0;
    pthread_mutex_unlock(&l->lock);
    if (last)
        lend_end(l);
}
