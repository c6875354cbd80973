/* box.h - a consumer for the tests of sources: it counts what comes and keeps it when asked to.
 * Waits are for conditions and long: the machine may be busy. */
#ifndef BOX_H
#define BOX_H
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "capture/source/source.h"
#include "tests/lib/patience.h"

#define BOX_HELD 512

struct box {
    pthread_mutex_t lock;
    pthread_cond_t change;
    bool keep; /* frames are kept until empty_box */
    struct cap_frame *held[BOX_HELD];
    uint64_t n_held, n, count[CAP_N_COUNT], first_id, last_id, holes, lost, ended, readings;
    bool ids_fall;
    int64_t off_ns;                       /* t_device - arrival of the last frame */
    bool stamped;                         /* it had a t_device */
    int64_t device_ns, mono_ns, bound_ns; /* last reading of the camera's clock */
};
#define BOX_EMPTY                                                             \
    {                                                                         \
        .lock = PTHREAD_MUTEX_INITIALIZER, .change = PTHREAD_COND_INITIALIZER \
    }

static inline void on_push(void *ctx, struct cap_frame *f)
{
    struct box *b = ctx;
    pthread_mutex_lock(&b->lock);
    if (b->n == 0)
        b->first_id = f->id;
    else if (f->id <= b->last_id)
        b->ids_fall = true;
    else
        b->holes += f->id - b->last_id - 1;
    b->last_id = f->id;
    b->n++;
    b->stamped = f->t_device_ns != 0;
    b->off_ns = f->t_device_ns - f->t_arrival_mono_ns;
    bool keep = b->keep && b->n_held < BOX_HELD;
    if (keep)
        b->held[b->n_held++] = f;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
    if (!keep)
        cap_frame_release(f);
}

static inline void on_event(void *ctx, uint32_t camera, enum cap_event ev)
{
    struct box *b = ctx;
    (void)camera;
    pthread_mutex_lock(&b->lock);
    b->lost += ev == CAP_EV_LOST;
    b->ended += ev == CAP_EV_END;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
}

static inline void on_count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct box *b = ctx;
    (void)camera;
    pthread_mutex_lock(&b->lock);
    b->count[what] += n;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
}

static inline void on_clock(void *ctx, uint32_t camera, int64_t device_ns, int64_t mono_ns,
                            int64_t bound_ns)
{
    struct box *b = ctx;
    (void)camera;
    pthread_mutex_lock(&b->lock);
    b->readings++;
    b->device_ns = device_ns;
    b->mono_ns = mono_ns;
    b->bound_ns = bound_ns;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
}

#define SINK_OF(b)                                                                           \
    {                                                                                        \
        .push = on_push, .event = on_event, .count = on_count, .clock = on_clock, .ctx = (b) \
    }

static inline void empty_box(struct box *b)
{
    struct cap_frame *f[BOX_HELD];
    pthread_mutex_lock(&b->lock);
    uint64_t n = b->n_held;
    memcpy(f, b->held, sizeof f);
    b->n_held = 0;
    pthread_mutex_unlock(&b->lock);
    for (uint64_t i = 0; i < n; i++)
        cap_frame_release(f[i]);
}

/* Frames that come from now on are kept, or not. */
static inline void keep_box(struct box *b, bool keep)
{
    pthread_mutex_lock(&b->lock);
    b->keep = keep;
    pthread_mutex_unlock(&b->lock);
}

static inline void reset_box(struct box *b, bool keep)
{
    empty_box(b);
    pthread_mutex_lock(&b->lock);
    b->keep = keep;
    b->n = b->holes = b->lost = 0;
    b->ids_fall = false;
    memset(b->count, 0, sizeof b->count);
    pthread_mutex_unlock(&b->lock);
}

static inline bool wait_under_lock(struct box *b, const uint64_t *what, uint64_t n)
{
    UNTIL (*what >= n) {
        struct timespec ts;
        clock_gettime(CLOCK_REALTIME, &ts);
        ts.tv_sec++;
        pthread_cond_timedwait(&b->change, &b->lock, &ts);
    }
    return *what >= n;
}

/* Until one of the box's counts is n, or n more than now. */
static inline bool wait_count(struct box *b, const uint64_t *what, uint64_t n)
{
    pthread_mutex_lock(&b->lock);
    bool ok = wait_under_lock(b, what, n);
    pthread_mutex_unlock(&b->lock);
    return ok;
}

static inline bool wait_more(struct box *b, const uint64_t *what, uint64_t n)
{
    pthread_mutex_lock(&b->lock);
    bool ok = wait_under_lock(b, what, *what + n);
    pthread_mutex_unlock(&b->lock);
    return ok;
}

/* The oldest that is kept, NULL when none comes.  Owner: caller. */
static inline struct cap_frame *next_frame(struct box *b)
{
    struct cap_frame *f = NULL;
    pthread_mutex_lock(&b->lock);
    if (wait_under_lock(b, &b->n_held, 1)) {
        f = b->held[0];
        memmove(b->held, b->held + 1, (size_t)--b->n_held * sizeof(b->held[0]));
    }
    pthread_mutex_unlock(&b->lock);
    return f;
}

static inline uint64_t counted(struct box *b, enum cap_count what)
{
    pthread_mutex_lock(&b->lock);
    uint64_t n = b->count[what];
    pthread_mutex_unlock(&b->lock);
    return n;
}

static inline uint32_t checksum(const struct cap_image *img)
{
    uint32_t h = 2166136261u;
    for (size_t i = 0; i < img->size; i++)
        h = (h ^ ((const unsigned char *)img->data)[i]) * 16777619u;
    return h;
}

/* A machine this busy may stall for longer than a camera may be silent: what is lost then is no fault. */
static inline bool machine_is_busy(void)
{
    const char *slow = getenv("VM_SLOW");
    return slow != NULL && atof(slow) > 2.5;
}
#endif
