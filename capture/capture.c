#include "capture/rig/capture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/capture_int.h"
#include "capture/rig/trigger.h"

#define DEFAULT_BUFFERS 12
#define QUEUED_SETS     2
#define MIN_QUIET_NS    (700 * PVX_NS_PER_MS)
#define STUCK_NS        (3 * PVX_NS_PER_S)

#define US 1000
#define MS PVX_NS_PER_MS
const int64_t cap_skew_edges_ns[CAP_SKEW_BINS - 1] = {
    -50 * MS,  -20 * MS,  -10 * MS, -5 * MS,  -2 * MS,  -1 * MS,  -500 * US,
    -200 * US, -100 * US, -50 * US, -20 * US, -10 * US, -5 * US,  -2 * US,
    2 * US,    5 * US,    10 * US,  20 * US,  50 * US,  100 * US, 200 * US,
    500 * US,  1 * MS,    2 * MS,   5 * MS,   10 * MS,  20 * MS,  50 * MS};

void cap_wait_until(pthread_cond_t *cond, pthread_mutex_t *lock, int64_t mono_ns)
{
    struct timespec ts = {.tv_sec = mono_ns / PVX_NS_PER_S, .tv_nsec = mono_ns % PVX_NS_PER_S};
    pthread_cond_timedwait(cond, lock, &ts);
}

static void empty_rings(struct cap_capture *cap)
{
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        for (;;) {
            pthread_mutex_lock(&cap->lock);
            struct cap_frame *f = cam->head;
            cam->head = NULL;
            if (f == NULL && cam->ring_len > 0)
                f = cap_intake_pop(cam);
            cam->count[CAP_OVERFLOW] += f != NULL;
            pthread_mutex_unlock(&cap->lock);
            if (f == NULL)
                break;
            cap_frame_release(f);
        }
    }
}

static void destroy(struct cap_capture *cap)
{
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        pthread_cond_destroy(&cam->wake);
        pthread_cond_destroy(&cam->room);
        free(cam->ring);
        free(cam->features);
        free(cam->name);
        free(cam->uri);
        free(cam->line);
    }
    free(cap->camera);
    pthread_mutex_destroy(&cap->lock);
    pthread_cond_destroy(&cap->work);
    pthread_cond_destroy(&cap->changed);
    pthread_cond_destroy(&cap->ending);
    free(cap);
}

void cap_capture_unref(struct cap_capture *cap)
{
    pthread_mutex_lock(&cap->lock);
    bool last = --cap->refs == 0;
    pthread_mutex_unlock(&cap->lock);
    if (last)
        destroy(cap);
}

static pvx_err known_scheme(struct cap_camera *cam, const char *uri, struct pvx_diag *d)
{
    const char *rest;
    cam->ops = cap_backend_find(uri, &rest);
    if (cam->ops != NULL) {
        cam->cfg.uri = rest;
        return PVX_OK;
    }
    char list[128] = "";
    for (const struct cap_source_ops *const *b = cap_backends(); *b != NULL; b++) {
        size_t n = strlen(list);
        snprintf(list + n, sizeof list - n, " %s:", (*b)->scheme);
    }
    return pvx_fail(d, PVX_EINVAL, "camera %s: \"%s\" is no source; there are%s", cam->name, uri,
                    list);
}

/* Recorded frames come as they were taken, whatever started them. */
static pvx_err can_trigger(const struct cap_camera *cam, struct pvx_diag *d)
{
    static const char *const by[] = {"", "by software", "by a line", "by action commands"};
    enum cap_trigger t = cam->cap->cfg.trigger;
    bool can = t == CAP_TRIGGER_SOFTWARE ? cam->ops->trigger != NULL : cam->ops->triggers;
    if (t == CAP_TRIGGER_FREE_RUN || cam->ops->recorded || can)
        return PVX_OK;
    return pvx_fail(d, PVX_EINVAL, "camera %s (%s): cannot be triggered %s", cam->name, cam->uri,
                    by[t]);
}

static pvx_err set_up_camera(struct cap_capture *cap, uint32_t i, struct pvx_diag *d)
{
    struct cap_camera *cam = &cap->camera[i];
    const struct cap_source_config *src = &cap->cfg.camera[i];
    if (src->uri == NULL)
        return pvx_fail(d, PVX_EINVAL, "camera %u has no source", i);
    char number[16];
    snprintf(number, sizeof number, "%u", i);
    cam->cfg = *src;
    cam->name = strdup(src->name != NULL ? src->name : number);
    cam->uri = strdup(src->uri);
    bool line = src->trigger_line != NULL && src->trigger_line[0] != '\0';
    cam->cfg.trigger_line = cam->line = strdup(line ? src->trigger_line : "Line1");
    cam->health = cap_health_unknown;
    if (cam->name == NULL || cam->uri == NULL || cam->line == NULL)
        return PVX_ENOMEM;
    PVX_TRY(known_scheme(cam, cam->uri, d));
    cam->cfg.name = cam->name;
    if (src->n_features > 0) {
        cam->features = pvx_calloc(src->n_features, sizeof *cam->features);
        if (cam->features == NULL)
            return PVX_ENOMEM;
        memcpy(cam->features, src->features, src->n_features * sizeof *cam->features);
    }
    cam->cfg.features = cam->features;
    cam->cfg.camera = i;
    cam->cfg.trigger = cap->cfg.trigger;
    cam->cfg.action = cap->cfg.action.keys;
    cam->cfg.lossless = cap->cfg.lossless;
    if (cam->cfg.fps <= 0)
        cam->cfg.fps = cap->cfg.fps;
    if (cam->cfg.buffers == 0)
        cam->cfg.buffers = DEFAULT_BUFFERS;
    if (cam->cfg.buffers < 4 || cam->cfg.buffers > 1024)
        return pvx_fail(d, PVX_EINVAL, "camera %s: %u buffers; 4 to 1024 are possible", cam->name,
                        cam->cfg.buffers);
    PVX_TRY(can_trigger(cam, d));
    cam->quiet_ns = 5 * cap->period_ns > MIN_QUIET_NS ? 5 * cap->period_ns : MIN_QUIET_NS;
    cam->width = src->width;
    cam->height = src->height;
    cam->fmt = src->fmt;
    bool mono = cam->ops->clock == CAP_CLOCK_MONO;
    cam->shows_real = (cap->cfg.shared_clock && !mono) || cam->ops->recorded;
    cap_clockmap_init(&cam->clock, cam->shows_real || mono);
    /* Half of the buffers may wait here, the other half is for sets and the driver. */
    cam->ring_size = cam->cfg.buffers / 2;
    cam->ring = pvx_calloc(cam->ring_size, sizeof *cam->ring);
    return cam->ring != NULL ? PVX_OK : PVX_ENOMEM;
}

static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct cap_capture *cap = ctx;
    pthread_mutex_lock(&cap->lock);
    cap->camera[camera].count[what] += n;
    pthread_mutex_unlock(&cap->lock);
}

/* What the assembler gives up: the count comes first. */
static void count_stray(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct cap_capture *cap = ctx;
    cap->stray = what;
    count(ctx, camera, what, n);
}

static void push_stray(void *ctx, struct cap_frame *f)
{
    struct cap_capture *cap = ctx;
    cap->cfg.tap.stray(cap->cfg.tap.ctx, f, cap->stray);
}

static void count_locked(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct cap_capture *cap = ctx;
    cap->camera[camera].count[what] += n;
}

static void detail_locked(void *ctx, uint32_t camera, enum cap_count what, const char *text)
{
    struct cap_capture *cap = ctx;
    snprintf(cap->camera[camera].detail[what], CAP_DETAIL_MAX, "%s", text);
}

static pvx_err set_up(struct cap_capture *cap, struct pvx_diag *d)
{
    const struct cap_capture_config *cfg = &cap->cfg;
    if (!(cfg->fps >= 0) || cfg->fps > 1e5)
        return pvx_fail(d, PVX_EINVAL, "%g frames per second are not possible", cfg->fps);
    cap->period_ns = cfg->fps > 0 ? llrint(1e9 / cfg->fps) : 0;
    bool paced = cfg->trigger == CAP_TRIGGER_SOFTWARE || cfg->trigger == CAP_TRIGGER_ACTION;
    if (paced && cap->period_ns == 0)
        return pvx_fail(d, PVX_EINVAL, "a software trigger needs a frame rate");
    cap->all_show_real = true;
    for (uint32_t i = 0; i < cap->n; i++) {
        PVX_TRY(set_up_camera(cap, i, d));
        cap->all_show_real &= cap->camera[i].shows_real;
    }
    struct cap_assembler_params p = cfg->sets;
    p.cameras = cap->n;
    if (p.period_ns == 0)
        p.period_ns = cap->period_ns;
    struct cap_sink counts = {
        .count = count_stray, .push = cfg->tap.stray != NULL ? push_stray : NULL, .ctx = cap};
    pvx_err e = cap_assembler_new(&p, &counts, &cap->assembler);
    if (e == PVX_EINVAL)
        return pvx_fail(d, e,
                        "frame sets: a tolerance of %.3f ms with a period of %.3f ms and at "
                        "least %u of %u cameras is not possible (tolerance: above 0, below "
                        "half a period)",
                        (double)p.tolerance_ns * 1e-6, (double)p.period_ns * 1e-6, p.min_cameras,
                        cap->n);
    PVX_TRY(e);
    for (uint32_t i = 0; i < cap->n; i++)
        cap_assembler_alive(cap->assembler, i, false);
    struct cap_syncwatch_params w = {.cameras = cap->n,
                                     .period_ns = p.period_ns,
                                     .tolerance_ns =
                                         p.tolerance_ns != 0 ? p.tolerance_ns : p.period_ns / 4,
                                     .paced_outside = cfg->trigger == CAP_TRIGGER_LINE};
    struct cap_sink found = {.count = count_locked, .ctx = cap};
    cap_syncwatch_init(&cap->watch, &w, &found, detail_locked);
    cap->watches = !cfg->lossless && cap->n > 1;
    return pvx_queue_new(QUEUED_SETS, &cap->out);
}

pvx_err cap_capture_new(const struct cap_capture_config *c, cap_capture **out, struct pvx_diag *d)
{
    *out = NULL;
    if (c->n_cameras < 1 || c->n_cameras > CAP_MAX_CAMERAS)
        return pvx_fail(d, PVX_EINVAL, "%u cameras; 1 to %d are possible", c->n_cameras,
                        CAP_MAX_CAMERAS);
    struct cap_capture *cap = pvx_calloc(1, sizeof *cap);
    if (cap == NULL)
        return PVX_ENOMEM;
    cap->camera = pvx_calloc(c->n_cameras, sizeof *cap->camera);
    if (cap->camera == NULL) {
        free(cap);
        return PVX_ENOMEM;
    }
    cap->cfg = *c;
    cap->n = c->n_cameras;
    cap->refs = 1;
    pthread_condattr_t a;
    pthread_condattr_init(&a);
    pthread_condattr_setclock(&a, CLOCK_MONOTONIC);
    pthread_mutex_init(&cap->lock, NULL);
    pthread_cond_init(&cap->work, &a);
    pthread_cond_init(&cap->changed, &a);
    pthread_cond_init(&cap->ending, &a);
    for (uint32_t i = 0; i < cap->n; i++) {
        cap->camera[i].cap = cap;
        cap->camera[i].index = i;
        pthread_cond_init(&cap->camera[i].wake, &a);
        pthread_cond_init(&cap->camera[i].room, &a);
    }
    pthread_condattr_destroy(&a);
    pvx_err e = set_up(cap, d);
    cap->cfg.camera = NULL; /* borrowed for set-up only */
    if (e != PVX_OK)
        cap_capture_free(&cap);
    *out = cap;
    return e;
}

pvx_err cap_capture_start(cap_capture *cap, struct pvx_diag *d)
{
    if (cap->started)
        return pvx_fail(d, PVX_EINVAL, "capture has been started before");
    cap->started = true;
    cap->started_mono_ns = pvx_now_mono();
    if (pthread_create(&cap->assembler_thread, NULL, cap_assemble, cap) != 0)
        return pvx_fail(d, PVX_EIO, "cannot start the assembler's thread");
    cap->assembler_started = true;
    pthread_setname_np(cap->assembler_thread, "assemble");
    if (pthread_create(&cap->monitor_thread, NULL, cap_monitor, cap) != 0) {
        cap_capture_stop(cap);
        return pvx_fail(d, PVX_EIO, "cannot start the monitor's thread");
    }
    cap->monitor_started = true;
    pthread_setname_np(cap->monitor_thread, "monitor");
    if (cap->cfg.trigger == CAP_TRIGGER_ACTION) {
        if (pthread_create(&cap->trigger_thread, NULL, cap_trigger_run, cap) != 0) {
            cap_capture_stop(cap);
            return pvx_fail(d, PVX_EIO, "cannot start the thread that triggers");
        }
        cap->trigger_started = true;
        pthread_setname_np(cap->trigger_thread, "trigger");
    }
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        pthread_mutex_lock(&cap->lock);
        cap->refs++;
        pthread_mutex_unlock(&cap->lock);
        if (pthread_create(&cam->thread, NULL, cap_supervise, cam) != 0) {
            cap_capture_unref(cap);
            cap_capture_stop(cap);
            return pvx_fail(d, PVX_EIO, "cannot start a thread for camera %s", cam->name);
        }
        cam->started = true;
        char name[16];
        snprintf(name, sizeof name, "cap%u", i);
        pthread_setname_np(cam->thread, name);
    }
    return PVX_OK;
}

pvx_err cap_capture_next(cap_capture *cap, int64_t timeout_ns, struct cap_set **out)
{
    void *item;
    pvx_err e = pvx_queue_take(cap->out, timeout_ns, &item);
    *out = item;
    return e;
}

/* Join the supervisors that come home in time, leave the others to themselves. */
static void end_supervisors(struct cap_capture *cap)
{
    int64_t until = pvx_now_mono() + STUCK_NS;
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        if (!cam->started)
            continue;
        pthread_mutex_lock(&cap->lock);
        while (!cam->done && pvx_now_mono() < until)
            cap_wait_until(&cap->changed, &cap->lock, until);
        bool done = cam->done;
        pthread_mutex_unlock(&cap->lock);
        if (done) {
            pthread_join(cam->thread, NULL);
        } else {
            LOG_W(CAPTURE, "camera %s (%s): its driver does not return; left behind", cam->name,
                  cam->uri);
            pthread_detach(cam->thread);
        }
    }
}

void cap_capture_stop(cap_capture *cap)
{
    pthread_mutex_lock(&cap->lock);
    if (cap->stop) { /* somebody is at it, or was */
        while (!cap->stopped)
            pthread_cond_wait(&cap->changed, &cap->lock);
        pthread_mutex_unlock(&cap->lock);
        return;
    }
    cap->stop = true;
    for (uint32_t i = 0; i < cap->n; i++) {
        pthread_cond_broadcast(&cap->camera[i].wake);
        pthread_cond_broadcast(&cap->camera[i].room);
    }
    pthread_cond_broadcast(&cap->work);
    pthread_cond_broadcast(&cap->ending);
    pthread_mutex_unlock(&cap->lock);
    if (cap->out != NULL)
        pvx_queue_close(cap->out);
    if (cap->trigger_started)
        pthread_join(cap->trigger_thread, NULL);
    end_supervisors(cap);
    if (cap->assembler_started)
        pthread_join(cap->assembler_thread, NULL);
    if (cap->monitor_started)
        pthread_join(cap->monitor_thread, NULL);
    empty_rings(cap);
    pthread_mutex_lock(&cap->lock);
    cap->stopped = true;
    pthread_cond_broadcast(&cap->changed);
    pthread_mutex_unlock(&cap->lock);
}

void cap_capture_free(cap_capture **cp)
{
    cap_capture *cap = *cp;
    if (cap == NULL)
        return;
    *cp = NULL;
    cap_capture_stop(cap);
    void *s;
    while (cap->out != NULL && pvx_queue_take(cap->out, 0, &s) == PVX_OK)
        cap_set_release(s);
    pvx_queue_free(&cap->out);
    cap_assembler_free(&cap->assembler);
    cap_capture_unref(cap);
}

/* Whole bins of the last 2 s, or of the time since the camera was started. */
static double frame_rate(const struct cap_camera *cam, int64_t now)
{
    int64_t slot = now / CAP_FPS_BIN_NS, first = slot - CAP_FPS_BINS;
    if (cam->first_slot + 1 > first)
        first = cam->first_slot + 1;
    if (first >= slot)
        return 0;
    uint64_t n = 0;
    for (int i = 0; i <= CAP_FPS_BINS; i++)
        if (cam->bin[i].slot >= first && cam->bin[i].slot < slot)
            n += cam->bin[i].n;
    return (double)n / ((double)(slot - first) * CAP_FPS_BIN_NS * 1e-9);
}

static void skew_stats(const struct cap_skew_count *k, struct cap_skew *out)
{
    out->n = k->abs.count;
    out->mean_ns = out->n > 0 ? k->sum_ns / (double)out->n : 0;
    out->p50_ns = pvx_hist_quantile(&k->abs, 0.5);
    out->p99_ns = pvx_hist_quantile(&k->abs, 0.99);
    out->max_ns = k->abs.max_ns;
    memcpy(out->bin, k->bin, sizeof out->bin);
}

static void camera_stats(const struct cap_camera *cam, int64_t now, struct cap_camera_stats *s)
{
    const struct cap_sync_camera *w = &cam->cap->watch.camera[cam->index];
    s->state = cam->state;
    memcpy(s->count, cam->count, sizeof s->count);
    memcpy(s->error, cam->error, sizeof s->error);
    s->fps = frame_rate(cam, now);
    s->drift_ppm = cam->drift_ppm;
    s->health = cam->health;
    s->action = cam->action;
    s->clock_delay_us = cam->clock.n_readings > 0 ? cam->clock.delay_ns * 1e-3 : NAN;
    s->hz = w->hz;
    s->phase_us = w->phase_ns * 1e-3;
    s->walk_us_per_s = w->walk_ns_per_s * 1e-3;
    skew_stats(&cam->skew, &s->skew);
    cap_monitor_troubles(cam, s);
}

void cap_capture_stats(cap_capture *cap, struct cap_stats *out)
{
    memset(out, 0, sizeof *out);
    int64_t now = pvx_now_mono();
    pthread_mutex_lock(&cap->lock);
    for (uint32_t i = 0; i < cap->n; i++)
        camera_stats(&cap->camera[i], now, &out->camera[i]);
    out->sets_complete = cap->sets_complete;
    out->sets_partial = cap->sets_partial;
    out->sets_dropped = cap->sets_dropped;
    out->sets_failed = cap->sets_failed;
    out->spread = cap->spread;
    memcpy(out->spread_bin, cap->spread_bin, sizeof out->spread_bin);
    out->all_gone = cap->times_all_gone;
    out->action = cap->action;
    out->host_steps = cap->host.steps;
    out->host_step_ns = cap->host.last_step_ns;
    pthread_mutex_unlock(&cap->lock);
}
