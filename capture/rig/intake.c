/* intake.c - takes frames from the drivers' threads: checks them and their stamps, and puts them into the ring.
 * No logging, no lock and no waiting (except for room in a lossless run). */
#include <stdarg.h>
#include <stdio.h>

#include "base/clock.h"
#include "capture/rig/capture_int.h"

#define STILL     3  /* equal stamps in a row: more than one frame sent twice */
#define SLOT_BITS 24 /* bits of a bin that count frames */

void cap_intake_restart(struct cap_camera *cam)
{
    struct cap_intake *in = &cam->intake;
    int64_t now = pvx_now_mono();
    cam->life.silent_at = cam->count[CAP_RECEIVED];
    in->lost = in->ended = false;
    in->any_ns = in->good_ns = now;
    in->first_slot = now / CAP_FPS_BIN_NS;
    in->last_device_ns = 0;
    in->still = 0;
    in->discard = cam->ops->recorded ? 0 : cam->cap->cfg.discard_first;
    in->settled = false;
    in->n_settling = 0;
    in->starts++;
}

void cap_detail(struct cap_camera *cam, enum cap_count what, const char *format, ...)
{
    char text[CAP_DETAIL_MAX];
    va_list ap;
    va_start(ap, format);
    vsnprintf(text, sizeof text, format, ap);
    va_end(ap);
    pvx_board_write(&cam->detail[what], text, sizeof text);
}

/* A relaxed store is enough: there is one writer, and nothing depends on the order. */
#define show(p, value) atomic_store_explicit(p, value, memory_order_relaxed)

/* ---- checks of a frame ------------------------------------------------------------------------ */

static bool same_layout(struct cap_camera *cam, const struct cap_image *img)
{
    struct cap_intake *in = &cam->intake;
    if (in->fmt == CAP_FMT_NONE)
        in->fmt = img->fmt;
    if (in->width == 0)
        in->width = img->width;
    if (in->height == 0)
        in->height = img->height;
    if (img->fmt == CAP_FMT_NONE || img->fmt != in->fmt) {
        cap_detail(cam, CAP_BAD_FORMAT, "%s instead of %s", cap_pixfmt_name(img->fmt),
                   cap_pixfmt_name(in->fmt));
        cam->count[CAP_BAD_FORMAT]++;
        return false;
    }
    size_t row = cap_pixfmt_row(in->fmt, in->width), need = 1; /* JPEG: any length */
    if (row > 0)
        need = img->stride < (ptrdiff_t)row ? SIZE_MAX
                                            : (size_t)img->stride * (size_t)(in->height - 1) + row;
    if (img->width != in->width || img->height != in->height || img->size < need) {
        cap_detail(cam, CAP_BAD_SIZE, "%dx%d and %zu bytes instead of %dx%d", img->width,
                   img->height, img->size, in->width, in->height);
        cam->count[CAP_BAD_SIZE]++;
        return false;
    }
    return true;
}

static bool stamp_moves_on(struct cap_camera *cam, int64_t t)
{
    struct cap_intake *in = &cam->intake;
    if (t < 0 || t > INT64_MAX / 2) { /* invalid or nonsense: differences must not overflow */
        cam->count[CAP_BAD_STAMP]++;
        return false;
    }
    int64_t last = in->last_device_ns;
    in->last_device_ns = t; /* backwards: a new epoch, the next frame is compared with it */
    if (t == 0 || last == 0 || t > last) {
        in->still = 0;
        return true;
    }
    cam->count[CAP_BAD_STAMP]++;
    in->still = t == last ? in->still + 1 : 0;
    if (in->still >= STILL) {
        cap_detail(cam, CAP_CLOCK_STUCK, "%u frames in a row", in->still);
        cam->count[CAP_CLOCK_STUCK]++;
    }
    return false;
}

/* ---- readings of its clock -------------------------------------------------------------------- */

static void add_reading(struct cap_readings *r, const struct cap_reading *reading)
{
    r->reading[r->n < CAP_READINGS ? r->n++ : CAP_READINGS - 1] = *reading;
    pthread_mutex_unlock(&r->lock);
}

/* The first frames after a start are left out: as many as configured.  If the camera's clock is mapped, those of the
 * first quarter of a second are left out too, at most eight, so that one delayed frame does not decide where the
 * pictures belong.  They give the map the least delay, except a frame that would have to wait for the lock. */
static bool settling(struct cap_camera *cam, const struct cap_frame *f)
{
    struct cap_intake *in = &cam->intake;
    bool mapped = cam->own_clock && f->t_device_ns != 0;
    if (in->settled)
        return false;
    if (in->n_settling++ == 0)
        in->settling_ns = f->t_arrival_mono_ns;
    bool early = mapped && in->n_settling <= CAP_SETTLE_FRAMES &&
                 f->t_arrival_mono_ns - in->settling_ns < CAP_SETTLE_NS;
    if (in->n_settling > in->discard && !early) {
        in->settled = true;
        return false;
    }
    if (mapped && pthread_mutex_trylock(&cam->readings.lock) == 0)
        add_reading(&cam->readings,
                    &(struct cap_reading){f->t_device_ns, f->t_arrival_mono_ns, -1});
    return true;
}

/* ---- frame rate ------------------------------------------------------------------------------- */

static void tally(struct cap_intake *in, int64_t now)
{
    uint64_t slot = (uint64_t)(now / CAP_FPS_BIN_NS);
    _Atomic uint64_t *bin = &in->bin[slot % (CAP_FPS_BINS + 1)];
    uint64_t was = atomic_load_explicit(bin, memory_order_relaxed);
    show(bin, (was >> SLOT_BITS == slot ? was : slot << SLOT_BITS) + 1);
}

/* Frame rate over the whole bins of the last 2 s, or of the time since the camera was started. */
double cap_intake_fps(const struct cap_camera *cam, int64_t now)
{
    int64_t slot = now / CAP_FPS_BIN_NS, first = slot - CAP_FPS_BINS;
    if (cam->intake.first_slot + 1 > first)
        first = cam->intake.first_slot + 1;
    if (first >= slot)
        return 0;
    uint64_t n = 0;
    for (int i = 0; i <= CAP_FPS_BINS; i++) {
        uint64_t bin = cam->intake.bin[i];
        int64_t of = (int64_t)(bin >> SLOT_BITS);
        if (of >= first && of < slot)
            n += bin & ((1u << SLOT_BITS) - 1);
    }
    return (double)n / ((double)(slot - first) * CAP_FPS_BIN_NS * 1e-9);
}

/* ---- the sink --------------------------------------------------------------------------------- */

/* Whether the frame is good and wanted. */
static bool intake_accept(struct cap_camera *cam, const struct cap_frame *f)
{
    struct cap_intake *in = &cam->intake;
    show(&in->any_ns, f->t_arrival_mono_ns);
    if (!same_layout(cam, &f->img) || (f->set == 0 && !stamp_moves_on(cam, f->t_device_ns)))
        return false;
    if (settling(cam, f))
        return false;
    show(&in->good_ns, f->t_arrival_mono_ns); /* before the count: see over() of supervisor.c */
    tally(in, f->t_arrival_mono_ns);
    cam->count[CAP_RECEIVED]++;
    return true;
}

/* Put f into the ring.  Returns a frame that has no room: live, the oldest; lossless, f itself when the capture
 * stops. */
static struct cap_frame *intake_hand_over(struct cap_camera *cam, struct cap_frame *f)
{
    if (!cam->cap->cfg.lossless)
        return pvx_ring_push(cam->intake.ring, f);
    while (!cam->cap->stop) {
        if (pvx_ring_put(cam->intake.ring, f))
            return NULL;
        pvx_bell_wait(&cam->intake.room, INT64_MAX);
    }
    return f;
}

static void intake_push(void *ctx, struct cap_frame *f)
{
    struct cap_camera *cam = ctx;
    f->camera = cam->index;
    if (cam->cap->stop || !intake_accept(cam, f)) {
        cap_frame_release(f);
        return;
    }
    struct cap_frame *gone = intake_hand_over(cam, f);
    pvx_bell_ring(&cam->cap->work);
    if (gone != NULL)
        cam->count[CAP_OVERFLOW]++;
    cap_frame_release(gone);
}

struct cap_frame *cap_intake_pop(struct cap_camera *cam)
{
    struct cap_frame *f = pvx_ring_pop(cam->intake.ring);
    if (f != NULL && cam->cap->cfg.lossless)
        pvx_bell_ring(&cam->intake.room);
    return f;
}

static void event(void *ctx, uint32_t camera, enum cap_event ev)
{
    struct cap_camera *cam = ctx;
    (void)camera; /* known from the context */
    if (ev == CAP_EV_END)
        cam->intake.ended = true;
    else
        cam->intake.lost = true;
    pvx_bell_ring(&cam->life.wake);
}

static void intake_count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct cap_camera *cam = ctx;
    (void)camera;
    cam->count[what] += n;
    /* the camera sends, but nothing usable */
    if (what == CAP_INCOMPLETE || what == CAP_UNDERRUN || what == CAP_BAD_SIZE)
        cam->intake.any_ns = pvx_now_mono();
}

static void clock_reading(void *ctx, uint32_t camera, int64_t device_ns, int64_t host_mono_ns,
                          int64_t bound_ns)
{
    struct cap_camera *cam = ctx;
    (void)camera;
    if (bound_ns < 0)
        return;
    pthread_mutex_lock(&cam->readings.lock);
    add_reading(&cam->readings, &(struct cap_reading){device_ns, host_mono_ns, bound_ns});
}

static void intake_detail(void *ctx, uint32_t camera, enum cap_count what, const char *text)
{
    (void)camera;
    cap_detail(ctx, what, "%s", text);
}

struct cap_sink cap_intake_sink(struct cap_camera *cam)
{
    return (struct cap_sink){.push = intake_push,
                             .event = event,
                             .count = intake_count,
                             .ctx = cam,
                             .clock = clock_reading,
                             .detail = intake_detail};
}
