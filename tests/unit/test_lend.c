/* test_lend.c - a driver's buffers come back to it exactly once, whenever their frames are released. */
#include "../t.h"

#include <pthread.h>

#include "capture/source/lend.h"

#define N 6

struct driver {
    pthread_mutex_t lock;
    int queued[N]; /* times in the driver's queue: 0 or 1 */
    int n_queued, refuse, destroyed, unused[N];
};

static bool requeue(void *ctx, unsigned i)
{
    struct driver *d = ctx;
    pthread_mutex_lock(&d->lock);
    bool takes = d->refuse == 0;
    if (takes) {
        d->queued[i]++;
        d->n_queued++;
    } else {
        d->refuse--;
    }
    pthread_mutex_unlock(&d->lock);
    return takes;
}

static void destroy(void *ctx)
{
    ((struct driver *)ctx)->destroyed++;
}

static void unused(void *ctx, unsigned i)
{
    ((struct driver *)ctx)->unused[i]++;
}

static const struct cap_lend_ops ops = {requeue, destroy, unused};

static struct driver driver(void)
{
    return (struct driver){.lock = PTHREAD_MUTEX_INITIALIZER};
}

static cap_lend *lend(struct driver *d, uint32_t camera)
{
    cap_lend *l = NULL;
    T_EQ_I(cap_lend_new(N, 2, camera, &ops, d, &l), PVX_OK);
    return l;
}

/* The driver has filled buffer i. */
static void fill(struct driver *d, unsigned i)
{
    pthread_mutex_lock(&d->lock);
    T_EQ_I(d->queued[i], 1);
    d->queued[i]--;
    d->n_queued--;
    pthread_mutex_unlock(&d->lock);
}

T_CASE(refuses_what_is_not_possible)
{
    struct driver d = driver();
    cap_lend *l;
    T_EQ_I(cap_lend_new(0, 0, 0, &ops, &d, &l), PVX_EINVAL);
    T_EQ_I(cap_lend_new(2, 2, 0, &ops, &d, &l), PVX_EINVAL);
    T_EQ_I(cap_lend_new(CAP_BUFFERS_MAX + 3, 2, 0, &ops, &d, &l), PVX_EINVAL);
    T_OK(l == NULL);
    T_EQ_I(d.destroyed, 0);
}

T_CASE(never_takes_the_spare_ones)
{
    struct driver d = driver();
    cap_lend *l = lend(&d, 7);
    cap_lend_run(l, true);
    T_EQ_I(d.n_queued, N);
    struct cap_frame *f[N];
    for (unsigned i = 0; i < N; i++) {
        fill(&d, i);
        f[i] = cap_lend_out(l, i);
        T_EQ_I(f[i] != NULL, i < N - 2);
        if (f[i] == NULL)
            cap_lend_back(l, i);
        else
            T_EQ_I(f[i]->camera, 7);
    }
    T_EQ_I(d.n_queued, 2);
    T_EQ_I(cap_lend_n_out(l), N - 2);
    cap_frame_release(f[2]);
    T_EQ_I(d.queued[2], 1);
    fill(&d, 4);
    f[4] = cap_lend_out(l, 4);
    T_OK(f[4] != NULL);
    for (unsigned i = 0; i < N - 1; i++)
        if (i != 2)
            cap_frame_release(f[i]);
    for (unsigned i = 0; i < N; i++)
        T_EQ_I(d.queued[i], 1);
    cap_lend_close(&l);
    T_EQ_I(d.destroyed, 1);
}

T_CASE(frames_may_outlive_stop_start_and_close)
{
    struct driver d = driver();
    cap_lend *l = lend(&d, 0);
    cap_lend_run(l, true);
    fill(&d, 0);
    fill(&d, 1);
    fill(&d, 2);
    struct cap_frame *a = cap_lend_out(l, 0), *b = cap_lend_out(l, 1), *c = cap_lend_out(l, 2);
    cap_lend_run(l, false);
    d = driver(); /* stopped: the driver has forgotten all */
    cap_frame_release(a);
    T_EQ_I(d.n_queued, 0);
    cap_lend_run(l, true); /* all that are not out */
    T_EQ_I(d.n_queued, N - 2);
    T_EQ_I(d.queued[0], 1);
    cap_frame_release(b);
    T_EQ_I(d.queued[1], 1);
    cap_lend_run(l, false);
    cap_lend_close(&l);
    T_EQ_I(d.destroyed, 0);
    cap_frame_release(c);
    T_EQ_I(d.queued[2], 0);
    T_EQ_I(d.destroyed, 1);
}

T_CASE(asks_again_when_the_driver_refuses)
{
    struct driver d = driver();
    cap_lend *l = lend(&d, 0);
    d.refuse = 2;
    cap_lend_run(l, true);
    T_EQ_I(d.n_queued, N - 2);
    d.refuse = 1;
    T_EQ_I(cap_lend_retry(l), 1);
    T_EQ_I(cap_lend_retry(l), 0);
    T_EQ_I(cap_lend_retry(l), 0);
    for (unsigned i = 0; i < N; i++)
        T_EQ_I(d.queued[i], 1);
    /* buffers that the driver does not hold are not there to be lent from either */
    struct cap_frame *f[4];
    for (unsigned i = 0; i < 4; i++) {
        fill(&d, i);
        f[i] = cap_lend_out(l, i);
        T_OK(f[i] != NULL);
    }
    d.refuse = 1;
    cap_frame_release(f[0]);
    fill(&d, 4);
    T_OK(cap_lend_out(l, 4) == NULL);
    cap_lend_back(l, 4);
    T_EQ_I(cap_lend_retry(l), 0);
    for (unsigned i = 1; i < 4; i++)
        cap_frame_release(f[i]);
    T_EQ_I(d.n_queued, N);
    cap_lend_close(&l);
    T_EQ_I(d.destroyed, 1);
}

/* ---- a consumer in another thread, frames released while the source stops and closes ---- */

static struct cap_frame *mail[20 * N];
static unsigned mail_n;
static bool mail_end;
static pthread_mutex_t mail_lock = PTHREAD_MUTEX_INITIALIZER;

static void *consumer(void *arg)
{
    (void)arg;
    for (bool end = false; !end;) {
        pthread_mutex_lock(&mail_lock);
        struct cap_frame *f = mail_n > 0 ? mail[--mail_n] : NULL;
        end = f == NULL && mail_end;
        pthread_mutex_unlock(&mail_lock);
        cap_frame_release(f);
    }
    return NULL;
}

T_CASE(releases_race_with_stop_and_close)
{
    mail_end = false;
    pthread_t t;
    T_EQ_I(pthread_create(&t, NULL, consumer, NULL), 0);
    struct driver d[20];
    for (int round = 0; round < 20; round++) {
        d[round] = driver();
        cap_lend *l = lend(&d[round], 0);
        cap_lend_run(l, true);
        for (int k = 0; k < 200; k++) {
            unsigned i = 0;
            pthread_mutex_lock(&d[round].lock);
            while (i < N && d[round].queued[i] == 0)
                i++;
            if (i < N) {
                d[round].queued[i]--;
                d[round].n_queued--;
            }
            pthread_mutex_unlock(&d[round].lock);
            T_OK(i < N);
            struct cap_frame *f = cap_lend_out(l, i);
            if (f == NULL) {
                cap_lend_back(l, i);
                continue;
            }
            pthread_mutex_lock(&mail_lock);
            mail[mail_n++] = f;
            pthread_mutex_unlock(&mail_lock);
        }
        cap_lend_run(l, false);
        cap_lend_close(&l);
    }
    pthread_mutex_lock(&mail_lock);
    mail_end = true;
    pthread_mutex_unlock(&mail_lock);
    pthread_join(t, NULL);
    for (int round = 0; round < 20; round++)
        T_EQ_I(d[round].destroyed, 1);
}

/* A closed source's buffers are called unused, once each: at once, or when their frame is released. */
T_CASE(closed_buffers_are_unused_once)
{
    struct driver d = driver();
    cap_lend *l = lend(&d, 0);
    cap_lend_run(l, true);
    fill(&d, 1);
    fill(&d, 4);
    struct cap_frame *a = cap_lend_out(l, 1), *b = cap_lend_out(l, 4);
    T_OK(a != NULL && b != NULL);
    cap_lend_run(l, false);
    cap_lend_close(&l);
    for (int i = 0; i < N; i++)
        T_EQ_I(d.unused[i], i != 1 && i != 4);
    cap_frame_release(b);
    T_EQ_I(d.unused[4], 1);
    T_EQ_I(d.unused[1], 0);
    cap_frame_release(a);
    T_EQ_I(d.unused[1], 1);
    T_EQ_I(d.destroyed, 1);
}
