#include "base/pool.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/cpu.h"
#include "base/mem.h"

/* A loop lives on its caller's stack and is in the pool's list while it has tasks to hand out.  `users` counts the
 * workers inside it (under the lock), so that the caller leaves only when there are none.
 *
 * Its tasks are cut into as many parts as there are threads, at most PARTS.  A thread begins with its own part and
 * then helps the others.  So in successive loops over the same arrays a thread gets the same pieces.  Every other
 * loop goes backwards, and so begins with the data that the thread's cache saw last. */
#define PARTS 8
struct part {
    _Alignas(64) atomic_size_t claimed;
    size_t first, n;
};
struct loop {
    struct loop *next;
    pvx_task_fn fn;
    void *ctx;
    unsigned parts;
    bool backwards;
    atomic_uint users; /* changed under the lock */
    struct part part[PARTS];
};

struct pvx_pool {
    pthread_mutex_t lock;
    pthread_cond_t work; /* list became non-empty, or stop */
    pthread_cond_t idle; /* the users of some loop dropped to 0 */
    struct loop *list;
    int stop;
    unsigned n_threads; /* workers started */
    unsigned total;     /* workers + caller */
    atomic_uint loops;  /* so far */
    struct worker {
        pvx_pool *pool;
        pthread_t thread;
        unsigned number; /* 1.. */
    } * worker;
};

/* Runs tasks on thread `me`; all tasks are handed out when it returns. */
static void pool_drain(struct loop *l, unsigned me)
{
    for (unsigned k = 0; k < l->parts; k++) {
        struct part *p = &l->part[(me + k) % l->parts];
        size_t i;
        while ((i = atomic_fetch_add(&p->claimed, 1)) < p->n)
            l->fn(l->ctx, p->first + (l->backwards ? p->n - 1 - i : i));
    }
}

static void unlink_loop(pvx_pool *p, struct loop *l)
{
    for (struct loop **q = &p->list; *q != NULL; q = &(*q)->next)
        if (*q == l) {
            __atomic_store_n(q, l->next, __ATOMIC_RELAXED); /* has_work looks without the lock */
            return;
        }
}

/* Loops of one solve follow each other within microseconds, but waking a thread takes some tens.  So a worker that
 * has just worked spins for a short time, waiting for the next loop, before it sleeps.  A caller spins for the end
 * of its last task in the same way. */
#define SPIN_NS 30000
static bool has_work(const void *pool)
{
    const pvx_pool *p = pool;
    return __atomic_load_n(&p->list, __ATOMIC_RELAXED) != NULL;
}
static bool is_left(const void *loop)
{
    const struct loop *l = loop;
    return atomic_load(&l->users) == 0;
}
static void spin(bool (*until)(const void *), const void *ctx)
{
    int64_t end = pvx_now_mono() + SPIN_NS;
    do {
        for (int i = 0; i < 64; i++) {
            if (until(ctx))
                return;
#if defined(__x86_64__) || defined(__i386__)
            __builtin_ia32_pause();
#endif
        }
    } while (pvx_now_mono() < end);
}

static void *worker(void *arg)
{
    struct worker *w = arg;
    pvx_pool *p = w->pool;
    pthread_mutex_lock(&p->lock);
    for (;;) {
        while (p->list == NULL && !p->stop)
            pthread_cond_wait(&p->work, &p->lock);
        if (p->stop)
            break;
        struct loop *l = p->list;
        atomic_fetch_add(&l->users, 1);
        pthread_mutex_unlock(&p->lock);
        pool_drain(l, w->number);
        pthread_mutex_lock(&p->lock);
        unlink_loop(p, l);
        if (atomic_fetch_sub(&l->users, 1) == 1)
            pthread_cond_broadcast(&p->idle);
        if (p->list == NULL && !p->stop) {
            pthread_mutex_unlock(&p->lock);
            spin(has_work, p);
            pthread_mutex_lock(&p->lock);
        }
    }
    pthread_mutex_unlock(&p->lock);
    return NULL;
}

pvx_err pvx_pool_new(unsigned threads, const char *name, pvx_pool **out)
{
    *out = NULL;
    if (threads == 0) {
        threads = pvx_cpu_count();
        threads = threads > 256 ? 256 : threads;
    }
    if (threads > 256)
        return PVX_EINVAL;
    pvx_pool *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    p->worker = pvx_calloc(threads, sizeof *p->worker);
    if (p->worker == NULL) {
        free(p);
        return PVX_ENOMEM;
    }
    p->total = threads;
    pthread_mutex_init(&p->lock, NULL);
    pthread_cond_init(&p->work, NULL);
    pthread_cond_init(&p->idle, NULL);
    for (unsigned i = 0; i + 1 < threads; i++) {
        p->worker[i].pool = p;
        p->worker[i].number = i + 1;
        if (pthread_create(&p->worker[i].thread, NULL, worker, &p->worker[i]) != 0) {
            pvx_pool_free(&p);
            return PVX_EIO;
        }
        p->n_threads++;
        char tn[16];
        snprintf(tn, sizeof tn, "%.10s%u", name == NULL ? "pool" : name, i);
        pthread_setname_np(p->worker[i].thread, tn);
    }
    *out = p;
    return PVX_OK;
}

void pvx_pool_free(pvx_pool **pp)
{
    pvx_pool *p = *pp;
    if (p == NULL)
        return;
    pthread_mutex_lock(&p->lock);
    p->stop = 1;
    pthread_cond_broadcast(&p->work);
    pthread_mutex_unlock(&p->lock);
    for (unsigned i = 0; i < p->n_threads; i++)
        pthread_join(p->worker[i].thread, NULL);
    pthread_mutex_destroy(&p->lock);
    pthread_cond_destroy(&p->work);
    pthread_cond_destroy(&p->idle);
    free(p->worker);
    free(p);
    *pp = NULL;
}

unsigned pvx_pool_threads(const pvx_pool *p)
{
    return p == NULL ? 1 : p->total;
}

void pvx_pool_run(pvx_pool *p, size_t n, pvx_task_fn fn, void *ctx)
{
    bool backwards = p != NULL && n > 1 && atomic_fetch_add(&p->loops, 1) % 2 == 1;
    if (p == NULL || p->n_threads == 0 || n <= 1) {
        for (size_t i = 0; i < n; i++)
            fn(ctx, backwards ? n - 1 - i : i);
        return;
    }
    struct loop l = {.fn = fn, .ctx = ctx, .backwards = backwards};
    l.parts = p->total < PARTS ? p->total : PARTS;
    for (unsigned k = 0; k < l.parts; k++) {
        l.part[k].first = n * k / l.parts;
        l.part[k].n = n * (k + 1) / l.parts - l.part[k].first;
    }
    pthread_mutex_lock(&p->lock);
    struct loop **tail = &p->list;
    while (*tail != NULL)
        tail = &(*tail)->next;
    __atomic_store_n(tail, &l, __ATOMIC_RELAXED);
    pthread_cond_broadcast(&p->work);
    pthread_mutex_unlock(&p->lock);
    pool_drain(&l, 0);
    pthread_mutex_lock(&p->lock);
    unlink_loop(p, &l);
    if (!is_left(&l)) {
        pthread_mutex_unlock(&p->lock);
        spin(is_left, &l);
        pthread_mutex_lock(&p->lock);
    }
    while (!is_left(&l))
        pthread_cond_wait(&p->idle, &p->lock);
    pthread_mutex_unlock(&p->lock);
}
