/* setup.c - sets up a capture from its configuration: checks, copies, allocates. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/rig/backends.h"
#include "capture/rig/capture_int.h"

#define DEFAULT_BUFFERS 12
#define QUEUED_SETS     2
#define MIN_QUIET_NS    (700 * PVX_NS_PER_MS)

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

/* Whether the camera supports the rig's trigger.  Recorded frames come as they were exposed, with any trigger. */
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
    pvx_board_write(&cam->life.health, &cap_health_unknown, sizeof cap_health_unknown);
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
    if (cam->cfg.buffers < 4 + cam->cfg.held || cam->cfg.buffers > CAP_BUFFERS_MAX)
        return pvx_fail(d, PVX_EINVAL, "camera %s: %u buffers; 4 to %d are possible", cam->name,
                        cam->cfg.buffers, CAP_BUFFERS_MAX);
    PVX_TRY(can_trigger(cam, d));
    cam->quiet_ns = 5 * cap->period_ns > MIN_QUIET_NS ? 5 * cap->period_ns : MIN_QUIET_NS;
    cam->intake.width = src->width;
    cam->intake.height = src->height;
    cam->intake.fmt = src->fmt;
    bool mono = cam->ops->clock == CAP_CLOCK_MONO;
    cam->shows_real = (cap->cfg.shared_clock && !mono) || cam->ops->recorded;
    cam->own_clock = !cam->shows_real && !mono;
    cap_clockmap_init(&cam->assembly.clock, !cam->own_clock);
    /* Half of the buffers may wait here, the other half is for sets and the driver. */
    return pvx_ring_new((cam->cfg.buffers - cam->cfg.held) / 2, &cam->intake.ring);
}

static void setup_count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct cap_capture *cap = ctx;
    cap->camera[camera].count[what] += n;
}

static void setup_detail(void *ctx, uint32_t camera, enum cap_count what, const char *text)
{
    struct cap_capture *cap = ctx;
    cap_detail(&cap->camera[camera], what, "%s", text);
}

/* The assembler counts a frame before it pushes it as a stray, so the count gives the reason. */
static void count_stray(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct cap_capture *cap = ctx;
    cap->stray = what;
    setup_count(ctx, camera, what, n);
}

static void push_stray(void *ctx, struct cap_frame *f)
{
    struct cap_capture *cap = ctx;
    cap->cfg.tap.stray(cap->cfg.tap.ctx, f, cap->stray);
}

pvx_err cap_set_up(struct cap_capture *cap, struct pvx_diag *d)
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
    struct cap_sink found = {.count = setup_count, .ctx = cap};
    cap_syncwatch_init(&cap->watch, &w, &found, setup_detail);
    cap->watches = !cfg->lossless && cap->n > 1;
    return pvx_queue_new(QUEUED_SETS, &cap->out);
}

static void setup_undo(struct cap_capture *cap)
{
    cap_assemble_nothing(cap); /* frames of a driver that was left behind */
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        pvx_bell_fini(&cam->life.wake);
        pvx_bell_fini(&cam->intake.room);
        pthread_mutex_destroy(&cam->readings.lock);
        pvx_ring_free(&cam->intake.ring);
        free(cam->features);
        free(cam->name);
        free(cam->uri);
        free(cam->line);
    }
    free(cap->camera);
    pthread_mutex_destroy(&cap->stopping);
    pthread_mutex_destroy(&cap->figures);
    pvx_bell_fini(&cap->work);
    pvx_bell_fini(&cap->home);
    pvx_bell_fini(&cap->ending);
    free(cap);
}

void cap_capture_unref(struct cap_capture *cap)
{
    if (--cap->refs == 0)
        setup_undo(cap);
}
