#include "capture/source/bufpool.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>

#include "base/mem.h"

struct slot {
    struct cap_frame frame; /* first: a frame's address is its slot's */
    struct cap_bufpool *pool;
    struct slot *next; /* in the free list */
    void *mem;
};

struct cap_bufpool {
    pthread_mutex_t lock;
    pthread_cond_t freed; /* a slot came back, or canceled */
    struct slot *free;
    unsigned n, n_free;
    bool canceled, orphan; /* orphan: the source has dropped its reference */
    bool held;             /* pixels: of cap_source_memory */
    uint32_t camera;
    size_t bytes, step; /* of a frame; from one to the next */
    struct slot *slots;
    unsigned char *pixels;
};

static void bufpool_destroy(cap_bufpool *p)
{
    pthread_mutex_destroy(&p->lock);
    pthread_cond_destroy(&p->freed);
    if (p->held)
        pvx_unreserve(p->pixels, p->n * p->step);
    else
        free(p->pixels);
    free(p->slots);
    free(p);
}

static void put_back(struct cap_frame *f)
{
    struct slot *s = (struct slot *)f;
    cap_bufpool *p = s->pool;
    pthread_mutex_lock(&p->lock);
    s->next = p->free;
    p->free = s;
    p->n_free++;
    bool last = p->orphan && p->n_free == p->n;
    if (p->orphan && p->held)
        pvx_discard(s->mem, p->step);
    pthread_cond_signal(&p->freed);
    pthread_mutex_unlock(&p->lock);
    if (last)
        bufpool_destroy(p);
}

/* c NULL: no frame is kept for long. */
static pvx_err bufpool_make(const struct cap_source_config *c, unsigned n, size_t bytes,
                            uint32_t camera, cap_bufpool **out)
{
    *out = NULL;
    if (n < 1 || n > CAP_BUFFERS_MAX || bytes == 0 || bytes > (size_t)1 << 32)
        return PVX_EINVAL;
    size_t align = c != NULL ? PVX_PAGE : PVX_ALIGN, step = (bytes + align - 1) & ~(align - 1);
    cap_bufpool *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    p->slots = pvx_calloc(n, sizeof *p->slots);
    p->pixels = p->slots == NULL ? NULL
                : c != NULL      ? cap_source_memory(c, n * step)
                                 : pvx_calloc(n, step);
    if (p->pixels == NULL) {
        free(p->slots);
        free(p);
        return PVX_ENOMEM;
    }
    pthread_mutex_init(&p->lock, NULL);
    pthread_cond_init(&p->freed, NULL);
    p->n = p->n_free = n;
    p->bytes = bytes;
    p->step = step;
    p->held = c != NULL;
    p->camera = camera;
    for (unsigned i = n; i-- > 0;) {
        struct slot *s = &p->slots[i];
        s->pool = p;
        s->mem = p->pixels + i * step;
        s->next = p->free;
        p->free = s;
    }
    *out = p;
    return PVX_OK;
}

pvx_err cap_bufpool_new(unsigned n, size_t bytes, uint32_t camera, cap_bufpool **out)
{
    return bufpool_make(NULL, n, bytes, camera, out);
}

pvx_err cap_bufpool_of(const struct cap_source_config *c, unsigned n, size_t bytes,
                       cap_bufpool **out)
{
    return bufpool_make(c->held > 0 ? c : NULL, n, bytes, c->camera, out);
}

/* Under the lock, with the free list not empty. */
static struct cap_frame *bufpool_pop(cap_bufpool *p)
{
    struct slot *s = p->free;
    p->free = s->next;
    p->n_free--;
    s->frame = (struct cap_frame){.img = {.data = s->mem},
                                  .camera = p->camera,
                                  .exposure_us = NAN,
                                  .gain = NAN,
                                  .release = put_back,
                                  .owner = p};
    return &s->frame;
}

struct cap_frame *cap_bufpool_get(cap_bufpool *p)
{
    pthread_mutex_lock(&p->lock);
    struct cap_frame *f = p->free != NULL ? bufpool_pop(p) : NULL;
    pthread_mutex_unlock(&p->lock);
    return f;
}

struct cap_frame *cap_bufpool_get_wait(cap_bufpool *p)
{
    pthread_mutex_lock(&p->lock);
    while (p->free == NULL && !p->canceled)
        pthread_cond_wait(&p->freed, &p->lock);
    struct cap_frame *f = p->canceled ? NULL : bufpool_pop(p);
    pthread_mutex_unlock(&p->lock);
    return f;
}

static void set_canceled(cap_bufpool *p, bool on)
{
    pthread_mutex_lock(&p->lock);
    p->canceled = on;
    pthread_cond_broadcast(&p->freed);
    pthread_mutex_unlock(&p->lock);
}

void cap_bufpool_cancel(cap_bufpool *p)
{
    set_canceled(p, true);
}

void cap_bufpool_resume(cap_bufpool *p)
{
    set_canceled(p, false);
}

void *cap_bufpool_memory(const struct cap_frame *f)
{
    return ((const struct slot *)f)->mem;
}

size_t cap_bufpool_bytes(const cap_bufpool *p)
{
    return p->bytes;
}

void cap_bufpool_unref(cap_bufpool **pp)
{
    cap_bufpool *p = *pp;
    if (p == NULL)
        return;
    *pp = NULL;
    pthread_mutex_lock(&p->lock);
    p->orphan = true;
    bool last = p->n_free == p->n;
    for (struct slot *s = p->free; p->held && s != NULL; s = s->next)
        pvx_discard(s->mem, p->step);
    pthread_mutex_unlock(&p->lock);
    if (last)
        bufpool_destroy(p);
}
