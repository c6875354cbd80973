/* stats.c - the state and counts of a capture at one moment. */
#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "capture/rig/capture_int.h"

#define US 1000
#define MS PVX_NS_PER_MS
const int64_t cap_skew_edges_ns[CAP_SKEW_BINS - 1] = {
    -50 * MS,  -20 * MS,  -10 * MS, -5 * MS,  -2 * MS,  -1 * MS,  -500 * US,
    -200 * US, -100 * US, -50 * US, -20 * US, -10 * US, -5 * US,  -2 * US,
    2 * US,    5 * US,    10 * US,  20 * US,  50 * US,  100 * US, 200 * US,
    500 * US,  1 * MS,    2 * MS,   5 * MS,   10 * MS,  20 * MS,  50 * MS};

static void skew_stats(const struct cap_skew_count *k, struct cap_skew *out)
{
    out->n = k->abs.count;
    out->mean_ns = out->n > 0 ? k->sum_ns / (double)out->n : 0;
    out->p50_ns = pvx_hist_quantile(&k->abs, 0.5);
    out->p99_ns = pvx_hist_quantile(&k->abs, 0.99);
    out->max_ns = k->abs.max_ns;
    memcpy(out->bin, k->bin, sizeof out->bin);
}

static void stats_troubles(const struct cap_camera *cam, struct cap_camera_stats *s)
{
    s->n_troubles = 0;
    for (int k = 0; k < CAP_N_COUNT && s->n_troubles < CAP_TROUBLES_MAX; k++) {
        uint64_t begun = cam->trouble[k];
        if (begun == 0)
            continue;
        struct cap_trouble *t = &s->trouble[s->n_troubles++];
        t->cause = (enum cap_count)k;
        t->n = cam->count[k] - (begun - 1); /* count is read after begun, so it is never less */
        pvx_board_read(&cam->detail[k], t->detail, sizeof t->detail);
    }
}

static void camera_stats(const struct cap_camera *cam, int64_t now, struct cap_camera_stats *s)
{
    s->state = cam->life.state;
    if (!cap_delivers(cam))
        pvx_board_read(&cam->life.error, s->error, sizeof s->error);
    pvx_board_read(&cam->life.health, &s->health, sizeof s->health);
    pvx_board_read(&cam->answers, &s->action, sizeof s->action);
    s->fps = cap_intake_fps(cam, now);
    for (int k = 0; k < CAP_N_COUNT; k++)
        s->count[k] = cam->count[k];
    stats_troubles(cam, s);
}

/* The assembler's findings.  Under figures. */
static void assembly_stats(const struct cap_camera *cam, struct cap_camera_stats *s)
{
    const struct cap_sync_camera *w = &cam->cap->watch.camera[cam->index];
    const struct cap_clockmap *clock = &cam->assembly.clock;
    s->drift_ppm = cap_clockmap_drift(clock) * 1e6;
    s->clock_delay_us = clock->read.n > 0 ? clock->delay_ns * 1e-3 : NAN;
    s->hz = w->hz;
    s->phase_us = w->phase_ns * 1e-3;
    s->walk_us_per_s = w->walk_ns_per_s * 1e-3;
    skew_stats(&cam->assembly.skew, &s->skew);
}

void cap_capture_health(const cap_capture *cap, uint32_t camera, struct cap_health *out)
{
    pvx_board_read(&cap->camera[camera].life.health, out, sizeof *out);
}

void cap_capture_stats(cap_capture *cap, struct cap_stats *out)
{
    memset(out, 0, sizeof *out);
    int64_t now = pvx_now_mono();
    for (uint32_t i = 0; i < cap->n; i++)
        camera_stats(&cap->camera[i], now, &out->camera[i]);
    pvx_board_read(&cap->action, &out->action, sizeof out->action);
    out->all_gone = cap->times_all_gone;
    pthread_mutex_lock(&cap->figures);
    for (uint32_t i = 0; i < cap->n; i++)
        assembly_stats(&cap->camera[i], &out->camera[i]);
    out->sets_complete = cap->sets_complete;
    out->sets_partial = cap->sets_partial;
    out->sets_dropped = cap->sets_dropped;
    out->sets_failed = cap->sets_failed;
    out->spread = cap->spread;
    memcpy(out->spread_bin, cap->spread_bin, sizeof out->spread_bin);
    out->host_steps = cap->host.steps;
    out->host_step_ns = cap->host.last_step_ns;
    pthread_mutex_unlock(&cap->figures);
}

void cap_capture_counts(const cap_capture *c, uint32_t camera, uint64_t out[CAP_N_COUNT])
{
    for (int k = 0; k < CAP_N_COUNT; k++)
        out[k] = c->camera[camera].count[k];
}
