#include "base/queue.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>

#include "base/clock.h"
#include "base/mem.h"

struct pvx_queue {
    pthread_mutex_t lock;
    pthread_cond_t filled; /* an item came, or closed */
    pthread_cond_t room;   /* an item went, or closed */
    size_t cap, head, len;
    int closed;
    void *items[];
};

pvx_err pvx_queue_new(size_t capacity, pvx_queue **out)
{
    *out = NULL;
    if (capacity == 0 || capacity > 1u << 20)
        return PVX_EINVAL;
    pvx_queue *q = pvx_calloc(1, sizeof *q + capacity * sizeof q->items[0]);
    PVX_NEED(q);
    q->cap = capacity;
    pthread_mutex_init(&q->lock, NULL);
    pvx_cond_init(&q->filled, CLOCK_MONOTONIC);
    pvx_cond_init(&q->room, CLOCK_MONOTONIC);
    *out = q;
    return PVX_OK;
}

void pvx_queue_free(pvx_queue **q)
{
    if (*q == NULL)
        return;
    pthread_mutex_destroy(&(*q)->lock);
    pthread_cond_destroy(&(*q)->filled);
    pthread_cond_destroy(&(*q)->room);
    PVX_FREE(*q);
}

static void queue_push(pvx_queue *q, void *item)
{
    q->items[(q->head + q->len) % q->cap] = item;
    q->len++;
    pthread_cond_signal(&q->filled);
}

static void *queue_pop(pvx_queue *q)
{
    void *item = q->items[q->head];
    q->head = (q->head + 1) % q->cap;
    q->len--;
    return item;
}

void pvx_queue_put(pvx_queue *q, void *item, void **displaced)
{
    *displaced = NULL;
    pthread_mutex_lock(&q->lock);
    if (q->closed) {
        *displaced = item;
    } else {
        if (q->len == q->cap)
            *displaced = queue_pop(q);
        queue_push(q, item);
    }
    pthread_mutex_unlock(&q->lock);
}

pvx_err pvx_queue_put_wait(pvx_queue *q, void *item)
{
    pvx_err e = PVX_OK;
    pthread_mutex_lock(&q->lock);
    while (q->len == q->cap && !q->closed)
        pthread_cond_wait(&q->room, &q->lock);
    if (q->closed)
        e = PVX_ECLOSED;
    else
        queue_push(q, item);
    pthread_mutex_unlock(&q->lock);
    return e;
}

pvx_err pvx_queue_pop(pvx_queue *q, int64_t timeout_ns, void **item)
{
    pvx_err e = PVX_OK;
    *item = NULL;
    struct timespec until = {0};
    if (timeout_ns > 0) {
        int64_t t = pvx_now_mono() + timeout_ns;
        until.tv_sec = t / PVX_NS_PER_S;
        until.tv_nsec = t % PVX_NS_PER_S;
    }
    pthread_mutex_lock(&q->lock);
    while (q->len == 0 && !q->closed) {
        if (timeout_ns < 0)
            pthread_cond_wait(&q->filled, &q->lock);
        else if (timeout_ns == 0 ||
                 pthread_cond_timedwait(&q->filled, &q->lock, &until) == ETIMEDOUT)
            break;
    }
    if (q->len > 0) {
        *item = queue_pop(q);
        pthread_cond_signal(&q->room);
    } else {
        e = q->closed ? PVX_ECLOSED : PVX_ETIMEDOUT;
    }
    pthread_mutex_unlock(&q->lock);
    return e;
}

void pvx_queue_close(pvx_queue *q)
{
    pthread_mutex_lock(&q->lock);
    q->closed = 1;
    pthread_cond_broadcast(&q->filled);
    pthread_cond_broadcast(&q->room);
    pthread_mutex_unlock(&q->lock);
}

size_t pvx_queue_length(pvx_queue *q)
{
    pthread_mutex_lock(&q->lock);
    size_t n = q->len;
    pthread_mutex_unlock(&q->lock);
    return n;
}
