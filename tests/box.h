/* box.h - a consumer for the tests of one source: it counts what comes and keeps it when asked to.
 * Waits are for conditions and long: the machine may be busy. */
#ifndef BOX_H
#define BOX_H
#include <pthread.h>
#include "base/clock.h"
#include "capture/source/source.h"

#define BOX_PATIENCE_NS (60 * PVX_NS_PER_S) /* no wait in here should come near */
#define BOX_HELD        64

static struct box {
    pthread_mutex_t lock;
    pthread_cond_t change;
    bool keep; /* frames are kept until empty_box */
    struct cap_frame *held[BOX_HELD];
    unsigned n_held;
    uint64_t n, count[CAP_N_COUNT], first_id, last_id, holes, lost;
    bool ids_fall;
    int64_t off_ns; /* t_device - arrival of the last frame */
    bool stamped;   /* it had a t_device */
} box = {.lock = PTHREAD_MUTEX_INITIALIZER, .change = PTHREAD_COND_INITIALIZER};

static void on_push(void *ctx, struct cap_frame *f)
{
    (void)ctx;
    pthread_mutex_lock(&box.lock);
    if (box.n == 0)
        box.first_id = f->id;
    else if (f->id <= box.last_id)
        box.ids_fall = true;
    else
        box.holes += f->id - box.last_id - 1;
    box.last_id = f->id;
    box.n++;
    box.stamped = f->t_device_ns != 0;
    box.off_ns = f->t_device_ns - f->t_arrival_mono_ns;
    bool keep = box.keep && box.n_held < BOX_HELD;
    if (keep)
        box.held[box.n_held++] = f;
    pthread_cond_broadcast(&box.change);
    pthread_mutex_unlock(&box.lock);
    if (!keep)
        cap_frame_release(f);
}

static void on_event(void *ctx, uint32_t camera, enum cap_event ev)
{
    (void)ctx, (void)camera;
    pthread_mutex_lock(&box.lock);
    box.lost += ev == CAP_EV_LOST;
    pthread_cond_broadcast(&box.change);
    pthread_mutex_unlock(&box.lock);
}

static void on_count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx, (void)camera;
    pthread_mutex_lock(&box.lock);
    box.count[what] += n;
    pthread_cond_broadcast(&box.change);
    pthread_mutex_unlock(&box.lock);
}

__attribute__((unused)) static const struct cap_sink sink = {
    .push = on_push, .event = on_event, .count = on_count};

__attribute__((unused)) static void empty_box(void)
{
    struct cap_frame *f[BOX_HELD];
    pthread_mutex_lock(&box.lock);
    unsigned n = box.n_held;
    memcpy(f, box.held, sizeof f);
    box.n_held = 0;
    pthread_mutex_unlock(&box.lock);
    for (unsigned i = 0; i < n; i++)
        cap_frame_release(f[i]);
}

/* Frames that come from now on are kept, or not. */
__attribute__((unused)) static void keep_box(bool keep)
{
    pthread_mutex_lock(&box.lock);
    box.keep = keep;
    pthread_mutex_unlock(&box.lock);
}

__attribute__((unused)) static void reset_box(bool keep)
{
    empty_box();
    pthread_mutex_lock(&box.lock);
    box.keep = keep;
    box.n = box.holes = 0;
    box.lost = 0;
    box.ids_fall = false;
    memset(box.count, 0, sizeof box.count);
    pthread_mutex_unlock(&box.lock);
}

static bool wait_under_lock(const uint64_t *what, uint64_t n)
{
    int64_t until = pvx_now_mono() + BOX_PATIENCE_NS;
    while (*what < n && pvx_now_mono() < until) {
        struct timespec ts;
        clock_gettime(CLOCK_REALTIME, &ts);
        ts.tv_sec++;
        pthread_cond_timedwait(&box.change, &box.lock, &ts);
    }
    return *what >= n;
}

/* Until one of the box's counts is n, or n more than now. */
__attribute__((unused)) static bool wait_count(const uint64_t *what, uint64_t n)
{
    pthread_mutex_lock(&box.lock);
    bool ok = wait_under_lock(what, n);
    pthread_mutex_unlock(&box.lock);
    return ok;
}

__attribute__((unused)) static bool wait_more(const uint64_t *what, uint64_t n)
{
    pthread_mutex_lock(&box.lock);
    bool ok = wait_under_lock(what, *what + n);
    pthread_mutex_unlock(&box.lock);
    return ok;
}

/* A machine this busy may stall for longer than a camera may be silent: what is lost then is no fault. */
__attribute__((unused)) static bool machine_is_busy(void)
{
    const char *slow = getenv("VM_SLOW");
    return slow != NULL && atof(slow) > 2.5;
}

__attribute__((unused)) static bool wait_lost(void)
{
    return wait_count(&box.lost, 1);
}
#endif
