#include "base/pool.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"

/* A loop lives on its caller's stack and hangs in the pool's list while it has tasks to hand out.
 * `users` counts workers inside it (under the lock), so the caller leaves only when nobody looks. */
struct loop {
    struct loop *next;
    pvx_task_fn fn;
    void *ctx;
    size_t n;
    atomic_size_t taken;
    unsigned users;
};

struct pvx_pool {
    pthread_mutex_t lock;
    pthread_cond_t work; /* list became non-empty, or stop */
    pthread_cond_t idle; /* some loop's users dropped to 0 */
    struct loop *list;
    int stop;
    unsigned n_threads; /* workers started */
    unsigned total;     /* workers + caller */
    pthread_t *threads;
};

static void drain(struct loop *l)
{
    size_t i;
    while ((i = atomic_fetch_add(&l->taken, 1)) < l->n)
        l->fn(l->ctx, i);
}

static void unlink_loop(pvx_pool *p, struct loop *l)
{
    for (struct loop **q = &p->list; *q != NULL; q = &(*q)->next)
        if (*q == l) {
            __atomic_store_n(q, l->next,
                             __ATOMIC_RELAXED); /* spin_for_work looks without the lock */
            return;
        }
}

/* Loops of one solve follow each other within microseconds, but waking a thread costs some tens: a
 * worker that has just worked looks for the next loop a little before it sleeps. */
#define SPIN_NS 30000
static void spin_for_work(pvx_pool *p)
{
    int64_t until = pvx_now_mono() + SPIN_NS;
    do {
        for (int i = 0; i < 64; i++) {
            if (__atomic_load_n(&p->list, __ATOMIC_RELAXED) != NULL)
                return;
#if defined(__x86_64__) || defined(__i386__)
            __builtin_ia32_pause();
#endif
        }
    } while (pvx_now_mono() < until);
}

static void *worker(void *arg)
{
    pvx_pool *p = arg;
    pthread_mutex_lock(&p->lock);
    for (;;) {
        while (p->list == NULL && !p->stop)
            pthread_cond_wait(&p->work, &p->lock);
        if (p->stop)
            break;
        struct loop *l = p->list;
        l->users++;
        pthread_mutex_unlock(&p->lock);
        drain(l);
        pthread_mutex_lock(&p->lock);
        unlink_loop(p, l);
        if (--l->users == 0)
            pthread_cond_broadcast(&p->idle);
        if (p->list == NULL && !p->stop) {
            pthread_mutex_unlock(&p->lock);
            spin_for_work(p);
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
        long n = sysconf(_SC_NPROCESSORS_ONLN);
        threads = n < 1 ? 1 : n > 256 ? 256 : (unsigned)n;
    }
    if (threads > 256)
        return PVX_EINVAL;
    pvx_pool *p = pvx_calloc(1, sizeof *p);
    if (p == NULL)
        return PVX_ENOMEM;
    p->threads = pvx_calloc(threads, sizeof *p->threads);
    if (p->threads == NULL) {
        free(p);
        return PVX_ENOMEM;
    }
    p->total = threads;
    pthread_mutex_init(&p->lock, NULL);
    pthread_cond_init(&p->work, NULL);
    pthread_cond_init(&p->idle, NULL);
    for (unsigned i = 0; i + 1 < threads; i++) {
        if (pthread_create(&p->threads[i], NULL, worker, p) != 0) {
            pvx_pool_free(&p);
            return PVX_EIO;
        }
        p->n_threads++;
        char tn[16];
        snprintf(tn, sizeof tn, "%.10s%u", name == NULL ? "pool" : name, i);
        pthread_setname_np(p->threads[i], tn);
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
        pthread_join(p->threads[i], NULL);
    pthread_mutex_destroy(&p->lock);
    pthread_cond_destroy(&p->work);
    pthread_cond_destroy(&p->idle);
    free(p->threads);
    free(p);
    *pp = NULL;
}

unsigned pvx_pool_threads(const pvx_pool *p)
{
    return p == NULL ? 1 : p->total;
}

void pvx_pool_run(pvx_pool *p, size_t n, pvx_task_fn fn, void *ctx)
{
    if (p == NULL || p->n_threads == 0 || n <= 1) {
        for (size_t i = 0; i < n; i++)
            fn(ctx, i);
        return;
    }
    struct loop l = {.fn = fn, .ctx = ctx, .n = n};
    pthread_mutex_lock(&p->lock);
    struct loop **tail = &p->list;
    while (*tail != NULL)
        tail = &(*tail)->next;
    __atomic_store_n(tail, &l, __ATOMIC_RELAXED);
    pthread_cond_broadcast(&p->work);
    pthread_mutex_unlock(&p->lock);
    drain(&l);
    pthread_mutex_lock(&p->lock);
    unlink_loop(p, &l);
    while (l.users > 0)
        pthread_cond_wait(&p->idle, &p->lock);
    pthread_mutex_unlock(&p->lock);
}
