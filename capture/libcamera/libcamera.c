/* libcamera.c - libcamera: cameras on a CSI bus (Raspberry Pi, laptops) and USB.
 *
 * Zero copy: the buffers that libcamera's handler allocates are mapped once, go to the consumer and come back
 * (lend.h).  Images are copied instead if there are fewer buffers than the configuration's `buffers` and the two that
 * stay with the camera (the handler of USB cameras always has four).
 * libcamera's one thread for all cameras hands frames over.  The C++ is in shim.cpp.
 * A camera that libcamera reports as disconnected is lost at once, and found again by its name when it is back.
 * hold.h explains what this needs.
 *
 * Times: SensorTimestamp.  libcamera says that it counts like CLOCK_BOOTTIME, but handlers pass on the kernel's
 * CLOCK_MONOTONIC.  The two differ by the time that the host has slept, so the time of arrival shows which clock it
 * is.  A stamp more than 10 s from both is not used.
 * Exposure and gain of each frame come from its metadata, if the handler gives them (USB: none). */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/source/backends.h"
#include "capture/source/bufpool.h"
#include "capture/source/gate.h"
#include "capture/source/lend.h"
#include "capture/libcamera/hold.h"
#include "capture/libcamera/modes.h"
#include "capture/libcamera/shim.h"
#include "base/module.h"
#include "capture/source/frame_number.h"

#define SPARE     2  /* buffers that always stay with the camera */
#define MAX_IDS   64 /* cameras of one host */
#define STAMP_MAX (10 * PVX_NS_PER_S)

struct buffers {
    struct cap_lc_camera *camera; /* for requeue, only between start and stop */
    struct cap_lc_memory *memory;
};

struct source {
    struct cap_source base;
    struct cap_source_config c; /* strings are copies */
    char *uri, *name;
    struct cap_lc_camera *camera;
    struct cap_lc_layout layout;
    enum cap_pixfmt fmt;
    uint8_t yuv;
    cap_lend *lend;
    struct buffers *buffers; /* of lend */
    cap_bufpool *pool;       /* images are copied into it; NULL: they are lent */
    struct cap_sink sink;
    bool started;

    /* libcamera's thread: */
    struct cap_numbering sequence;

    struct cap_gate gate;
    pthread_mutex_t lock; /* guards the fields below */
    bool odd_stamp;
    double temperature_c;
};

static struct pvx_module module = {
    .file = "pyrovox-libcamera.so", .entry = "cap_lc_module", .version = CAP_LC_VERSION};

static const struct cap_lc *lc(void)
{
    return module.is;
}

static pvx_err libcamera_need_module(struct pvx_diag *d)
{
    /* libcamera reads this when it is loaded.  Its errors come back as ours.  Its messages are off, unless the user
     * has set the variable. */
    setenv("LIBCAMERA_LOG_LEVELS", "*:ERROR", 0);
    if (pvx_module(&module) != NULL)
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP, "libcamera cannot be used: %.600s", module.why);
}

static pvx_err libcamera_refused(const struct source *s, int e, const char *err, struct pvx_diag *d)
{
    pvx_err r = e > 0 && e < PVX_N_ERR ? (pvx_err)e : PVX_EIO;
    return CAP_FAIL(&s->c, "libcamera", d, r, "%s", err[0] != '\0' ? err : pvx_strerror(r));
}

/* ---- finding ------------------------------------------------------------------------------------ */

struct ids {
    char *id[MAX_IDS], *model[MAX_IDS];
    size_t n;
};

static void add_id(void *ctx, const char *id, const char *model)
{
    struct ids *all = ctx;
    if (all->n == MAX_IDS)
        return;
    char *a = strdup(id), *b = strdup(model);
    if (a == NULL || b == NULL) {
        free(a);
        free(b);
        return;
    }
    all->id[all->n] = a;
    all->model[all->n++] = b;
}

static void free_ids(struct ids *all)
{
    for (size_t i = 0; i < all->n; i++) {
        free(all->id[i]);
        free(all->model[i]);
    }
}

static pvx_err find_ids(struct ids *all, struct pvx_diag *d)
{
    *all = (struct ids){.n = 0};
    PVX_TRY(libcamera_need_module(d));
    char err[256] = "";
    lc_hold();
    int e = lc()->list(add_id, all, err, sizeof err);
    if (e == PVX_OK)
        return PVX_OK;
    free_ids(all);
    return pvx_fail(d, PVX_EIO, "libcamera: %s", err);
}

struct lines {
    char text[2048];
    struct cap_lc_mode before; /* modes of one kind follow each other */
};

static void add_mode(void *ctx, const struct cap_lc_mode *m)
{
    struct lines *l = ctx;
    char line[96];
    enum cap_pixfmt f = lc_pixfmt(m->format);
    if (f == CAP_FMT_NONE)
        return;
    snprintf(line, sizeof line, "%s %dx%d", cap_pixfmt_name(f), m->width, m->height);
    const char *known = strstr(l->text, line);
    while (known != NULL && known[strlen(line)] != '\n' && known[strlen(line)] != '\0')
        known = strstr(known + 1, line);
    size_t at = strlen(l->text);
    if (known == NULL && at + strlen(line) + 2 < sizeof l->text)
        snprintf(l->text + at, sizeof l->text - at, "%s%s", at > 0 ? "\n" : "", line);
}

static pvx_err libcamera_list(void (*cb)(void *ctx, const struct cap_found *f), void *ctx,
                              struct pvx_diag *d)
{
    struct ids all;
    PVX_TRY(find_ids(&all, d));
    for (size_t i = 0; i < all.n; i++) {
        struct lines l = {.text = ""};
        char uri[256], text[256], err[256];
        snprintf(uri, sizeof uri, "libcamera:%s",
                 lc_short_name((const char *const *)all.id, all.n, i));
        snprintf(text, sizeof text, "%s, libcamera %s",
                 all.model[i][0] != '\0' ? all.model[i] : "camera", lc()->library);
        bool asked = lc()->modes(all.id[i], add_mode, &l, err, sizeof err) == PVX_OK;
        cb(ctx, &(struct cap_found){.uri = uri, .text = text, .formats = asked ? l.text : NULL});
    }
    free_ids(&all);
    return PVX_OK;
}

/* ---- buffers ------------------------------------------------------------------------------------ */

static bool libcamera_requeue(void *ctx, unsigned index)
{
    const struct buffers *b = ctx;
    return lc()->requeue(b->camera, index) == PVX_OK;
}

static void libcamera_destroy(void *ctx)
{
    struct buffers *b = ctx;
    lc()->unmap(b->memory);
    free(b);
}

static const struct cap_lend_ops lend_ops = {libcamera_requeue, libcamera_destroy, NULL};

/* Takes ownership of the memory. */
static pvx_err libcamera_make_buffers(struct source *s, struct cap_lc_memory *memory,
                                      struct pvx_diag *d)
{
    unsigned want = s->c.buffers < 4 ? 4 : s->c.buffers, n = s->layout.buffers;
    struct buffers *b = pvx_calloc(1, sizeof *b);
    pvx_err e = b == NULL ? PVX_ENOMEM : PVX_OK;
    if (e == PVX_OK && n <= SPARE)
        e = CAP_FAIL(&s->c, "libcamera", d, PVX_ENOMEM, "gives only %u buffers", n);
    if (e == PVX_OK) {
        *b = (struct buffers){s->camera, memory};
        e = cap_lend_new(n, SPARE, s->c.camera, &lend_ops, b, &s->lend);
    }
    if (e != PVX_OK) {
        lc()->unmap(memory);
        free(b);
        return e;
    }
    s->buffers = b;
    if (n >= want + SPARE)
        return PVX_OK;
    size_t bytes = cap_pixfmt_image(s->fmt, s->layout.mode.width, s->layout.mode.height);
    if (s->layout.frame_bytes > bytes)
        bytes = s->layout.frame_bytes;
    return cap_bufpool_of(&s->c, want, bytes, &s->pool);
}

/* ---- libcamera's thread ------------------------------------------------------------------------- */

static void libcamera_count(struct source *s, enum cap_count what, uint64_t n)
{
    s->sink.count(s->sink.ctx, s->c.camera, what, n);
}

static void on_gone(void *ctx)
{
    struct source *s = ctx;
    cap_gate_lost(&s->gate, &s->sink, s->c.camera);
}

/* Number of the next good frame.  Counts the frames missing before it. */
static uint64_t libcamera_number(struct source *s, uint32_t counter)
{
    uint64_t gap, id = cap_numbering_next(&s->sequence, counter, &gap);
    if (gap > 0)
        libcamera_count(s, CAP_ID_GAP, gap);
    return id;
}

/* Time of exposure on CLOCK_MONOTONIC; 0 = not known. */
static int64_t libcamera_exposure_time(struct source *s, int64_t stamp, int64_t mono)
{
    struct timespec ts;
    clock_gettime(CLOCK_BOOTTIME, &ts);
    int64_t slept = ts.tv_sec * PVX_NS_PER_S + ts.tv_nsec - pvx_now_mono();
    if (stamp > 0 && llabs(stamp - mono) < STAMP_MAX)
        return stamp;
    if (stamp > 0 && llabs(stamp - slept - mono) < STAMP_MAX)
        return stamp - slept;
    pthread_mutex_lock(&s->lock);
    s->odd_stamp = true;
    pthread_mutex_unlock(&s->lock);
    return 0;
}

static struct cap_frame *libcamera_frame_for(struct source *s, const struct cap_lc_frame *in)
{
    struct cap_frame *f;
    if (s->pool == NULL) {
        f = cap_lend_out(s->lend, in->index);
        if (f != NULL)
            f->img.data = in->data;
        return f;
    }
    f = cap_bufpool_get(s->pool);
    if (f != NULL && in->bytes <= cap_bufpool_bytes(s->pool))
        memcpy(cap_bufpool_memory(f), in->data, in->bytes);
    return f;
}

static void libcamera_deliver(struct source *s, const struct cap_lc_frame *in)
{
    int64_t real = 0, mono = 0;
    pvx_now_both(&real, &mono);
    bool fits = s->pool == NULL || in->bytes <= cap_bufpool_bytes(s->pool);
    if (in->good <= 0 || in->bytes == 0 || !fits) {
        s->sequence.bad++;
        if (in->good >= 0)
            libcamera_count(s, CAP_INCOMPLETE, 1);
        cap_lend_back(s->lend, in->index);
        return;
    }
    uint64_t id = libcamera_number(s, in->sequence);
    struct cap_frame *f = libcamera_frame_for(s, in);
    if (f == NULL || s->pool != NULL)
        cap_lend_back(s->lend, in->index);
    if (f == NULL) {
        libcamera_count(s, CAP_UNDERRUN, 1);
        return;
    }
    f->img.size = in->bytes;
    f->img.width = s->layout.mode.width;
    f->img.height = s->layout.mode.height;
    f->img.stride = s->fmt == CAP_JPEG ? 0 : (ptrdiff_t)s->layout.stride;
    f->img.fmt = s->fmt;
    f->img.yuv = s->yuv;
    f->id = id;
    f->t_device_ns = libcamera_exposure_time(s, in->stamp_ns, mono);
    f->t_arrival_ns = real;
    f->t_arrival_mono_ns = mono;
    f->exposure_us = in->exposure_us;
    f->gain = in->gain;
    s->sink.push(s->sink.ctx, f);
}

static void on_frame(void *ctx, const struct cap_lc_frame *in)
{
    struct source *s = ctx;
    if (!cap_gate_enter(&s->gate))
        return; /* its buffer is queued again at the next start */
    if (!isnan(in->temperature_c)) {
        pthread_mutex_lock(&s->lock);
        s->temperature_c = in->temperature_c;
        pthread_mutex_unlock(&s->lock);
    }
    libcamera_deliver(s, in);
    cap_gate_leave(&s->gate);
}

/* ---- operations --------------------------------------------------------------------------------- */

static void libcamera_close(cap_source **sp)
{
    struct source *s = (struct source *)*sp;
    if (s == NULL)
        return;
    *sp = NULL;
    /* Memory that the consumer still uses stays mapped.  The camera is free for the next user. */
    if (s->camera != NULL)
        lc()->close(s->camera);
    cap_lend_close(&s->lend);
    cap_bufpool_unref(&s->pool);
    cap_gate_fini(&s->gate);
    pthread_mutex_destroy(&s->lock);
    free(s->uri);
    free(s->name);
    free(s);
}

struct choice {
    const struct cap_source_config *c;
    struct pvx_diag *d;
};

static int libcamera_choose(void *ctx, const struct cap_lc_mode *mode, size_t n, int32_t *w,
                            int32_t *h)
{
    struct choice *k = ctx;
    return lc_choose(k->c, mode, n, w, h, k->d);
}

static pvx_err open_camera(struct source *s, const char *id, struct pvx_diag *d)
{
    struct cap_lc_control *control = pvx_calloc(s->c.n_features + 1, sizeof *control);
    PVX_NEED(control);
    for (size_t i = 0; i < s->c.n_features; i++)
        control[i] = (struct cap_lc_control){s->c.features[i].name, s->c.features[i].value};
    struct choice k = {&s->c, d};
    struct cap_lc_config cfg = {.id = id,
                                .raw = cap_pixfmt_bayer(s->c.fmt) != NULL ||
                                       cap_pixfmt_layout(s->c.fmt) == CAP_LAYOUT_CSI,
                                .choose = libcamera_choose,
                                .choose_ctx = &k,
                                .buffers = (s->c.buffers < 4 ? 4 : s->c.buffers) + SPARE,
                                .frame_us = s->c.fps > 0 ? llrint(1e6 / s->c.fps) : 0,
                                .exposure_us = s->c.exposure_us,
                                .gain = s->c.gain,
                                .control = control,
                                .n_controls = s->c.n_features};
    struct cap_lc_memory *memory;
    char err[512] = "";
    int e = lc()->open(&cfg, &s->camera, &memory, &s->layout, err, sizeof err);
    free(control);
    if (e != PVX_OK)
        return libcamera_refused(s, e, err, d);
    s->fmt = lc_pixfmt(s->layout.mode.format);
    s->yuv = lc_yuv(&s->layout);
    return libcamera_make_buffers(s, memory, d);
}

static pvx_err libcamera_set_up(struct source *s, struct pvx_diag *d)
{
    struct ids all;
    size_t i = 0;
    PVX_TRY(find_ids(&all, d));
    pvx_err e = lc_match(s->uri, (const char *const *)all.id, all.n, &i, &s->c, d);
    PVX_THEN(e, open_camera(s, all.id[i], d));
    if (e == PVX_OK && s->c.fps > 0 && !s->layout.has_duration)
        CAP_LOG(PVX_LOG_INFO, &s->c, "libcamera", "own_rate",
                "its frame rate cannot be set through libcamera %s: it sends at its own",
                lc()->library);
    if (e == PVX_OK)
        CAP_DEBUG(&s->c, "libcamera", "%s, %s %dx%d, %u buffers%s", all.id[i],
                  cap_pixfmt_name(s->fmt), s->layout.mode.width, s->layout.mode.height,
                  s->layout.buffers, s->pool != NULL ? ", images are copied" : "");
    free_ids(&all);
    return e;
}

static pvx_err libcamera_open(const struct cap_source_config *c, cap_source **out,
                              struct pvx_diag *d)
{
    *out = NULL;
    struct source *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    s->base.ops = &cap_source_libcamera;
    pthread_mutex_init(&s->lock, NULL);
    cap_gate_init(&s->gate);
    s->temperature_c = NAN;
    s->c = *c;
    s->c.uri = s->uri = strdup(c->uri);
    s->c.name = s->name = strdup(c->name != NULL ? c->name : "?");
    pvx_err e = s->uri == NULL || s->name == NULL ? PVX_ENOMEM : libcamera_set_up(s, d);
    s->c.features = NULL; /* borrowed for the call */
    s->c.n_features = 0;
    cap_source *base = &s->base;
    if (e != PVX_OK)
        libcamera_close(&base);
    *out = e == PVX_OK ? &s->base : NULL;
    return e;
}

static pvx_err libcamera_start(cap_source *base, const struct cap_sink *sink, struct pvx_diag *d)
{
    struct source *s = (struct source *)base;
    struct cap_lc_sink to = {on_frame, on_gone, s};
    char err[256] = "";
    s->sink = *sink;
    s->odd_stamp = false;
    s->sequence = (struct cap_numbering){0};
    cap_gate_open(&s->gate);
    int e = lc()->start(s->camera, &to, err, sizeof err);
    if (e != PVX_OK) {
        cap_gate_shut(&s->gate);
        return libcamera_refused(s, e, err, d);
    }
    s->started = true;
    cap_lend_run(s->lend, true);
    return PVX_OK;
}

static void libcamera_stop(cap_source *base)
{
    struct source *s = (struct source *)base;
    if (!s->started)
        return;
    cap_gate_shut(&s->gate);
    cap_lend_run(s->lend, false);
    lc()->stop(s->camera);
    s->started = false;
}

static void libcamera_health(cap_source *base, struct cap_health *out)
{
    struct source *s = (struct source *)base;
    char text[256] = "";
    *out = cap_health_unknown;
    pthread_mutex_lock(&s->lock);
    out->temperature_c = s->temperature_c;
    bool odd = s->odd_stamp;
    pthread_mutex_unlock(&s->lock);
    cap_lend_retry(s->lend);
    if (lc()->differs(s->camera, text, sizeof text))
        CAP_LOG(PVX_LOG_WARN, &s->c, "libcamera", "controls", "%s", text);
    if (odd)
        LOG_EVERY(PVX_LOG_WARN, CAPTURE,
                  "a libcamera camera's time stamps are of no clock of this host: the time of "
                  "arrival is used");
}

const struct cap_source_ops cap_source_libcamera = {
    .scheme = "libcamera",
    .help = "camera that libcamera sees, by its id or a part of it that no other has",
    .clock = CAP_CLOCK_MONO,
    .open = libcamera_open,
    .start = libcamera_start,
    .health = libcamera_health,
    .stop = libcamera_stop,
    .close = libcamera_close,
    .list = libcamera_list,
};
