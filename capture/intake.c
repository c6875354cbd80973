/* intake.c - where drivers' threads hand over their frames: check, stamp order, bounded ring.
 * No logging and no waiting here (except for room in a lossless run). */
#include <stdio.h>

#include "base/clock.h"
#include "capture/capture_int.h"

#define STILL 3 /* equal stamps in a row: not one frame sent twice */

struct cap_frame *cap_intake_pop(struct cap_camera *cam)
{
    struct cap_frame *f = cam->ring[cam->ring_head];
    cam->ring_head = (cam->ring_head + 1) % cam->ring_size;
    cam->ring_len--;
    pthread_cond_signal(&cam->room);
    return f;
}

void cap_intake_restart(struct cap_camera *cam)
{
    cam->ev_lost = cam->ev_end = false;
    cam->delivering = false;
    cam->last_any_mono_ns = cam->last_good_mono_ns = pvx_now_mono();
    cam->answered_mono_ns = 0;
    cam->no_trigger = false;
    cam->last_device_ns = 0;
    cam->still = 0;
    cam->restarted = true;
    cam->discard = cam->ops->recorded ? 0 : cam->cap->cfg.discard_first;
    cam->settled = false;
    cam->n_settling = 0;
    cam->first_slot = cam->last_any_mono_ns / CAP_FPS_BIN_NS;
}

static bool same_layout(struct cap_camera *cam, const struct cap_image *img)
{
    if (cam->fmt == CAP_FMT_NONE)
        cam->fmt = img->fmt;
    if (cam->width == 0)
        cam->width = img->width;
    if (cam->height == 0)
        cam->height = img->height;
    if (img->fmt == CAP_FMT_NONE || img->fmt != cam->fmt) {
        cam->count[CAP_BAD_FORMAT]++;
        snprintf(cam->detail[CAP_BAD_FORMAT], CAP_DETAIL_MAX, "%s instead of %s",
                 cap_pixfmt_name(img->fmt), cap_pixfmt_name(cam->fmt));
        return false;
    }
    size_t row = cap_pixfmt_row(cam->fmt, cam->width), need = 1; /* JPEG: any length */
    if (row > 0)
        need = img->stride < (ptrdiff_t)row ? SIZE_MAX
                                            : (size_t)img->stride * (size_t)(cam->height - 1) + row;
    if (img->width != cam->width || img->height != cam->height || img->size < need) {
        cam->count[CAP_BAD_SIZE]++;
        snprintf(cam->detail[CAP_BAD_SIZE], CAP_DETAIL_MAX, "%dx%d and %zu bytes instead of %dx%d",
                 img->width, img->height, img->size, cam->width, cam->height);
        return false;
    }
    return true;
}

static bool stamp_moves_on(struct cap_camera *cam, int64_t t)
{
    if (t < 0 || t > INT64_MAX / 2) { /* "invalid", or nonsense: differences must not overflow */
        cam->count[CAP_BAD_STAMP]++;
        return false;
    }
    int64_t last = cam->last_device_ns;
    cam->last_device_ns = t; /* backwards: a new epoch, the next frame is measured against it */
    if (t == 0 || last == 0 || t > last) {
        cam->still = 0;
        return true;
    }
    cam->count[CAP_BAD_STAMP]++;
    cam->still = t == last ? cam->still + 1 : 0;
    if (cam->still >= STILL) {
        cam->count[CAP_CLOCK_STUCK]++;
        snprintf(cam->detail[CAP_CLOCK_STUCK], CAP_DETAIL_MAX, "%u frames in a row", cam->still);
    }
    return false;
}

static void tally(struct cap_camera *cam, int64_t now)
{
    int64_t slot = now / CAP_FPS_BIN_NS;
    size_t i = (size_t)(slot % (CAP_FPS_BINS + 1));
    if (cam->bin[i].slot != slot) {
        cam->bin[i].slot = slot;
        cam->bin[i].n = 0;
    }
    cam->bin[i].n++;
}

/* The first frames after a start are left out: as many as configured, and of a camera whose clock is
 * mapped those of the first quarter of a second, at most eight, so that one which was held up does not
 * decide where its pictures belong.  They tell the map what the least delay is. */
static bool settling(struct cap_camera *cam, const struct cap_frame *f)
{
    bool mapped = !cam->clock.shared && f->t_device_ns != 0;
    if (cam->settled)
        return false;
    if (cam->n_settling++ == 0)
        cam->settling_ns = f->t_arrival_mono_ns;
    bool early = mapped && cam->n_settling <= CAP_SETTLE_FRAMES &&
                 f->t_arrival_mono_ns - cam->settling_ns < CAP_SETTLE_NS;
    if (cam->n_settling > cam->discard && !early) {
        cam->settled = true;
        return false;
    }
    if (mapped)
        (void)cap_clockmap_add(&cam->clock, f->t_device_ns, f->t_arrival_mono_ns);
    return true;
}

/* Good and wanted?  Under the lock. */
static bool accept(struct cap_camera *cam, const struct cap_frame *f)
{
    int64_t now = f->t_arrival_mono_ns;
    cam->last_any_mono_ns = now;
    cam->no_trigger = false;
    if (!same_layout(cam, &f->img) || (f->set == 0 && !stamp_moves_on(cam, f->t_device_ns)))
        return false;
    if (settling(cam, f))
        return false;
    cam->last_good_mono_ns = now;
    cam->count[CAP_RECEIVED]++;
    tally(cam, now);
    if (!cam->delivering) {
        cam->delivering = true;
        cam->error[0] = '\0';
        pthread_cond_signal(&cam->wake); /* the supervisor tells it */
    }
    return true;
}

static void push(void *ctx, struct cap_frame *f)
{
    struct cap_camera *cam = ctx;
    struct cap_capture *cap = cam->cap;
    struct cap_frame *gone = f; /* released at the end: one that displaced, is bad, or comes late */
    f->camera = cam->index;
    pthread_mutex_lock(&cap->lock);
    if (!cap->stop && accept(cam, f)) {
        while (cap->cfg.lossless && cam->ring_len == cam->ring_size && !cap->stop)
            pthread_cond_wait(&cam->room, &cap->lock);
        if (cap->stop) {
            cam->count[CAP_OVERFLOW]++;
        } else {
            gone = NULL;
            if (cam->ring_len == cam->ring_size) {
                gone = cap_intake_pop(cam);
                cam->count[CAP_OVERFLOW]++;
            }
            cam->ring[(cam->ring_head + cam->ring_len++) % cam->ring_size] = f;
            pthread_cond_signal(&cap->work);
        }
    }
    pthread_mutex_unlock(&cap->lock);
    cap_frame_release(gone);
}

static void event(void *ctx, uint32_t camera, enum cap_event ev)
{
    struct cap_camera *cam = ctx;
    (void)camera; /* the context says it */
    pthread_mutex_lock(&cam->cap->lock);
    if (ev == CAP_EV_END)
        cam->ev_end = true;
    else
        cam->ev_lost = true;
    pthread_cond_signal(&cam->wake);
    pthread_mutex_unlock(&cam->cap->lock);
}

static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct cap_camera *cam = ctx;
    (void)camera;
    pthread_mutex_lock(&cam->cap->lock);
    cam->count[what] += n;
    /* it sends, though nothing that can be used */
    if (what == CAP_INCOMPLETE || what == CAP_UNDERRUN || what == CAP_BAD_SIZE)
        cam->last_any_mono_ns = pvx_now_mono();
    pthread_mutex_unlock(&cam->cap->lock);
}

static void clock_reading(void *ctx, uint32_t camera, int64_t device_ns, int64_t host_mono_ns,
                          int64_t bound_ns)
{
    struct cap_camera *cam = ctx;
    (void)camera;
    pthread_mutex_lock(&cam->cap->lock);
    unsigned i = cam->n_readings < CAP_READINGS ? cam->n_readings++ : CAP_READINGS - 1;
    cam->reading[i].device_ns = device_ns;
    cam->reading[i].mono_ns = host_mono_ns;
    cam->reading[i].bound_ns = bound_ns;
    pthread_mutex_unlock(&cam->cap->lock);
}

static void detail(void *ctx, uint32_t camera, enum cap_count what, const char *text)
{
    struct cap_camera *cam = ctx;
    (void)camera;
    pthread_mutex_lock(&cam->cap->lock);
    snprintf(cam->detail[what], CAP_DETAIL_MAX, "%s", text);
    pthread_mutex_unlock(&cam->cap->lock);
}

struct cap_sink cap_intake_sink(struct cap_camera *cam)
{
    return (struct cap_sink){.push = push,
                             .event = event,
                             .count = count,
                             .ctx = cam,
                             .clock = clock_reading,
                             .detail = detail};
}
