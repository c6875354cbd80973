#include "daemon/pipeline/live.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "daemon/config/endpoints.h"
#include "daemon/pipeline/beside.h"
#include "daemon/pipeline/cameras_in.h"
#include "daemon/pipeline/compute.h"
#include "daemon/pipeline/instant.h"
#include "daemon/pipeline/previews.h"
#include "daemon/pipeline/publish.h"
#include "daemon/pipeline/recording.h"
#include "daemon/pipeline/scene.h"
#include "daemon/pipeline/sources.h"
#include "daemon/pipeline/watch.h"
#include "recon/matrix/active.h"

#define LOOK_ROWS 8 /* of a picture's rows one in so many is looked at for its depth */

struct dmn_live {
    struct dmn_config cfg;
    pvp_auth *auth;      /* borrowed; NULL: no keys */
    const char *open_to; /* endpoint of cfg that is open to all; NULL: none */
    struct rec_rig rig;
    char *rig_text;                  /* as it was read, for subscribers */
    struct rec_sysmat_params matrix; /* resolved */
    pvx_pool *pool;
    rec_sysmat *S;
    dmn_scene *scene; /* NULL: no camera is simulated */
    struct dmn_sources sources;
    cap_capture *capture;
    dmn_recording *recording;   /* NULL = cannot */
    dmn_triggers_run *triggers; /* NULL: no ring */
    dmn_beside *beside;         /* NULL = cannot */
    dmn_photometry *light;      /* NULL = none */
    dmn_images *images;
    dmn_background *background;
    dmn_instant *instant;
    struct dmn_cameras_in in;
    struct dmn_publish out;
    dmn_watch *watch;
    rec_average *average;         /* NULL: the cameras are taken as they are */
    dmn_previews *previews;       /* NULL = none */
    dmn_temperature *temperature; /* NULL = none */
    struct dmn_compute compute;
    dmn_pipeline *pipeline;
    atomic_bool stopping;
    int64_t t_start_ns;
};

static void live_snapshot(void *ctx, struct dmn_state *out)
{
    dmn_live_snapshot(ctx, out);
}

/* Load the rig's photometry after a check that it belongs to the configured cameras. */
static pvx_err find_light(dmn_live *l, struct pvx_diag *d)
{
    const struct dmn_config *c = &l->cfg;
    char path[PATH_MAX];
    dmn_config_path(c, c->rig, path, sizeof path);
    for (size_t i = 0; i < l->rig.n_cameras; i++) {
        const struct cap_source_config *s = &l->sources.source[i];
        const struct dmn_photometry_taken as = {
            .exposure_s = s->exposure_us >= 0 ? s->exposure_us * 1e-6 : NAN,
            .gain_db = s->gain >= 0 ? s->gain : NAN,
            .temperature_c = NAN, /* checked with the serial number at run time: cameras_in.c */
            .serial = l->rig.cameras[i].photometry.device[0] == '\0' ? s->uri : NULL};
        PVX_TRY(dmn_photometry_check(&l->rig.cameras[i], &as, c->name, d));
    }
    return dmn_photometry_load(path, DMN_LIGHT_ALL, &l->rig, &l->light, d);
}

static void live_look(void *ctx, const struct cap_frame *f)
{
    dmn_live *l = ctx;
    dmn_triggers_frame(l->triggers, l->rig.cameras[f->camera].name, f);
}

static pvx_err find_device(dmn_live *l, struct pvx_diag *d)
{
    char what[PATH_MAX + 16];
    snprintf(what, sizeof what, "%s: compute", l->cfg.name);
    const struct dmn_compute_want want = {
        .word = l->cfg.compute, .what = what, .refused = dmn_config_card_why_not(&l->cfg)};
    return dmn_compute_open(&want, &l->compute, d);
}

/* Measures, where that decides.  Says what was chosen. */
static pvx_err choose_device(dmn_live *l, struct rec_frame_params *p, struct pvx_diag *d)
{
    const struct dmn_compute_job job = {.S = l->S, .rig = &l->rig, .pool = l->pool};
    PVX_TRY(dmn_compute_choose(&l->compute, &job, p, d));
    if (l->compute.said[0] != '\0')
        pvx_log(l->compute.warn ? PVX_LOG_WARN : PVX_LOG_INFO, TOPIC_RECON,
                ABOUT(.cause = "compute"), "%s", l->compute.said);
    return PVX_OK;
}

/* Check all that can be wrong in configuration and rig, before anything that takes long. */
static pvx_err pipeline_prepare(dmn_live *l, struct pvx_diag *d)
{
    const struct dmn_config *c = &l->cfg;
    enum cap_mosaic mosaic;
    PVX_TRY(dmn_config_mosaic(c, &mosaic, d));
    PVX_TRY(dmn_config_bars(c, d));
    PVX_TRY(find_device(l, d));
    char path[PATH_MAX];
    PVX_TRY(dmn_config_rig(c, &l->rig, d));
    dmn_config_path(c, c->rig, path, sizeof path);
    PVX_TRY(dmn_config_sees(&l->rig, path, d));
    PVX_TRY(dmn_temperature_new(c, &l->rig, c->error_bars, &l->temperature, d));
    l->out.temperature = l->temperature;
    size_t len;
    PVX_TRY(rec_rig_format(&l->rig, &l->rig_text, &len));
    l->out.rig_text = l->rig_text;
    PVX_TRY(pvx_pool_new((unsigned)c->threads, "work", &l->pool));
    if (dmn_config_simulated(c))
        PVX_TRY(dmn_scene_new(&l->rig, (uint32_t)c->sim_seed, c->sim_period_s, c->sim_ignite_s,
                              &l->scene));
    PVX_TRY(dmn_sources_init(&l->sources, c, &l->rig, dmn_scene_cap(l->scene), d));
    uint64_t *session = &l->out.start.session;
    if (getrandom(session, sizeof *session, 0) != (ssize_t)sizeof *session)
        *session = (uint64_t)pvx_now_real();
    PVX_TRY(dmn_recording_new(c, &l->rig, &l->sources, &l->capture, *session, &l->recording, d));
    if (dmn_recording_ring(l->recording) != NULL)
        PVX_TRY(dmn_triggers_new(c, dmn_recording_ring(l->recording), &l->triggers));
    l->out.triggers = l->triggers;
    for (size_t i = 0; i < l->rig.n_cameras; i++)
        if (l->sources.source[i].lines)
            l->sources.capture.look = live_look;
    l->sources.capture.look_ctx = l;
    PVX_TRY(dmn_beside_new(c, *session, &l->beside, d));
    PVX_TRY(find_light(l, d)); /* sets gains of the rig to 1; the recording has copied them */
    PVX_TRY(cap_capture_new(&l->sources.capture, &l->capture, d));
    l->matrix = (struct rec_sysmat_params){.binning = (int32_t)c->binning,
                                           .rays_per_bin = (int32_t)c->rays};
    return rec_sysmat_resolve(&l->rig, &l->matrix, &l->matrix, d);
}

static pvx_err matrix_open(dmn_live *l, rec_progress_fn progress, void *ctx, struct pvx_diag *d)
{
    char path[PATH_MAX];
    dmn_config_path(&l->cfg, l->cfg.cache, path, sizeof path);
    int64_t t0 = pvx_now_mono();
    PVX_TRY(rec_sysmat_open(&l->rig, &l->matrix, l->cfg.cache[0] != '\0' ? path : NULL, l->pool,
                            (struct rec_progress){progress, ctx}, &l->S, d));
    LOG_I(RECON,
          "matrix: %zu cameras, %dx%dx%d voxels, binning %d, %d rays per bin side, "
          "%.1f million entries, %s in %.2f s",
          l->S->n_cameras, l->S->grid.n[0], l->S->grid.n[1], l->S->grid.n[2], l->S->binning,
          l->S->rays_per_bin, (double)l->S->nnz * 1e-6, l->S->cached ? "read" : "built",
          (double)(pvx_now_mono() - t0) * 1e-9);
    return PVX_OK;
}

static void carved(void *ctx, const struct dmn_slot *s)
{
    dmn_live *l = ctx;
    dmn_watch_offer(l->watch, s);
    dmn_previews_offer(l->previews, s);
}

/* The options of c that may change while the daemon runs. */
static struct dmn_tuning tuning(const dmn_live *l, const struct dmn_config *c)
{
    struct rec_frame_params f;
    dmn_config_frame(c, &f);
    bool free = c->deadline_ms < 0 && !c->lossless;
    return (struct dmn_tuning){.photo = f.photo,
                               .solve = f.solve,
                               .warm = dmn_config_warm(c),
                               .limit_ns = dmn_config_deadline(c),
                               .period_ns = free ? l->sources.capture.sets.period_ns : 0};
}

/* Age, ns, at which a set gives way to a newer one; 0 = never. */
static int64_t stale_after(const struct dmn_config *c, const struct dmn_tuning *t)
{
    bool least = c->deadline_ms < 0 && t->limit_ns < DMN_HICCUP_NS;
    return c->lossless ? 0 : least ? DMN_HICCUP_NS : t->limit_ns;
}

/* Number of sets that come within DMN_HICCUP_NS, 1 to DMN_WAITING_MAX. */
static size_t waiting(const struct dmn_config *c, const struct dmn_tuning *t)
{
    int64_t n = !c->lossless && t->period_ns > 0 ? DMN_HICCUP_NS / t->period_ns : 1;
    return n < 1 ? 1 : n > DMN_WAITING_MAX ? DMN_WAITING_MAX : (size_t)n;
}

/* The pipeline between cameras and publisher. */
static pvx_err live_connect_all(dmn_live *l, struct pvx_diag *d)
{
    const struct dmn_config *c = &l->cfg;
    struct dmn_images_params ip = {.nch = dmn_config_channels(c),
                                   .binning = l->S->binning,
                                   .fmt = dmn_config_pixfmt(c),
                                   .transfer = (enum cap_transfer)c->transfer,
                                   .light = l->light,
                                   .alike = dmn_config_channels(c) == 3,
                                   .look = LOOK_ROWS};
    PVX_TRY(dmn_config_mosaic(c, &ip.mosaic, d));
    PVX_TRY(dmn_images_new(&ip, &l->rig, l->pool, &l->images, d));
    dmn_images_black(l->images, (float)c->black);
    PVX_TRY(dmn_background_new(l->S, &l->rig, ip.nch, &l->background, d));
    PVX_TRY(dmn_instant_new(&l->rig.grid, ip.nch, &l->stopping, &l->instant));
    l->out.instant = l->instant;
    const struct dmn_tuning t = tuning(l, c);
    l->in = (struct dmn_cameras_in){.capture = l->capture,
                                    .images = l->images,
                                    .rig = &l->rig,
                                    .sets = l->sources.capture.sets,
                                    .stale_ns = stale_after(c, &t),
                                    .wait_for = c->wait_subscriber ? &l->out.subscribers : NULL,
                                    .stopping = &l->stopping,
                                    .background = l->background,
                                    .instant = l->instant,
                                    .pipeline = &l->pipeline};
    struct dmn_pipeline_params pp = {.S = l->S,
                                     .rig = &l->rig,
                                     .pool = l->pool,
                                     .lossless = c->lossless,
                                     .warm = t.warm,
                                     .bars = c->error_bars && c->lossless ? REC_BARS_USUAL : 0,
                                     .draws = c->error_bars && !c->lossless,
                                     .period_ns = (int64_t)(1 / c->fps * (double)PVX_NS_PER_S),
                                     .waiting = waiting(c, &t),
                                     .deadline = {.limit_ns = t.limit_ns, .period_ns = t.period_ns},
                                     .source = dmn_cameras_source(&l->in),
                                     .sink = dmn_publish_sink(&l->out),
                                     .carved = carved,
                                     .carved_ctx = l};
    char rig_path[PATH_MAX];
    dmn_config_path(c, c->rig, rig_path, sizeof rig_path);
    PVX_TRY(dmn_watch_new(&l->rig, rig_path, c->saturated == 1, l->S, &l->watch, d));
    const struct dmn_previews_params vp = {.config = c,
                                           .rig = &l->rig,
                                           .S = l->S,
                                           .pool = l->pool,
                                           .auth = l->auth,
                                           .start = &l->out.start,
                                           .rig_text = l->rig_text};
    PVX_TRY(dmn_previews_new(&vp, &l->previews, d));
    const struct dmn_temperature_params tp = {
        .config = c, .auth = l->auth, .start = &l->out.start, .rig_text = l->rig_text};
    PVX_TRY(dmn_temperature_open(l->temperature, &tp, d));
    dmn_config_frame(c, &pp.frame);
    PVX_TRY(choose_device(l, &pp.frame, d));
    if (pp.frame.selfcal != REC_SELFCAL_OFF)
        PVX_TRY(rec_average_new(l->rig.n_cameras, l->S->binning, REC_AVERAGE_BLOCK,
                                REC_AVERAGE_BLOCKS, &l->average));
    pp.average = l->average;
    return dmn_pipeline_new(&pp, &l->pipeline, d);
}

static dmn_live *live_empty(const struct dmn_config *cfg)
{
    dmn_live *l = pvx_calloc(1, sizeof *l);
    if (l == NULL)
        return NULL;
    l->cfg = *cfg;
    l->out.snapshot = live_snapshot;
    l->out.ctx = l;
    return l;
}

pvx_err dmn_live_new(const struct dmn_config *cfg, pvp_auth *auth, rec_progress_fn progress,
                     void *progress_ctx, dmn_live **out, struct pvx_diag *d)
{
    dmn_live *l = *out = live_empty(cfg);
    PVX_NEED(l);
    l->auth = auth;
    pvx_err e = dmn_endpoints_allowed(&l->cfg, &l->open_to, d);
    PVX_THEN(e, pipeline_prepare(l, d));
    PVX_THEN(e, dmn_publish_open(&l->out, &l->cfg, &l->rig, auth, d));
    PVX_THEN(e, matrix_open(l, progress, progress_ctx, d));
    PVX_THEN(e, live_connect_all(l, d));
    if (e != PVX_OK)
        dmn_live_free(out);
    return e;
}

pvx_err dmn_live_check(const struct dmn_config *cfg, double *matrix, struct pvx_diag *d)
{
    dmn_live *l = live_empty(cfg);
    PVX_NEED(l);
    pvx_err e = pipeline_prepare(l, d);
    *matrix = e == PVX_OK ? rec_sysmat_whole(&l->rig, &l->matrix) : 0;
    dmn_live_free(&l);
    return e;
}

pvx_err dmn_live_start(dmn_live *l, struct pvx_diag *d)
{
    char where[PATH_MAX];
    l->t_start_ns = l->out.rate_t_ns = pvx_now_mono();
    if (l->cfg.record_mode != 0)
        PVX_TRY(dmn_recording_start(l->recording, NULL, where, sizeof where, d));
    if (l->cfg.record_volumes != 0)
        PVX_TRY(dmn_beside_start(l->beside, where, sizeof where, d));
    if (dmn_recording_ring(l->recording) != NULL)
        PVX_TRY(cap_ring_start(dmn_recording_ring(l->recording), d));
    PVX_TRY(cap_capture_start(l->capture, d));
    return dmn_pipeline_start(l->pipeline, d);
}

bool dmn_live_finished(dmn_live *l)
{
    return dmn_pipeline_finished(l->pipeline);
}

void dmn_live_stop(dmn_live *l, const char *reason)
{
    atomic_store(&l->out.end_reason, reason);
    atomic_store(&l->stopping, true);
    dmn_recording_hurry(l->recording);
    cap_capture_stop(l->capture); /* carve sees the end, then each later stage */
    dmn_pipeline_join(l->pipeline);
    dmn_beside_end(l->beside);
    if (dmn_recording_ring(l->recording) != NULL)
        cap_ring_stop(dmn_recording_ring(l->recording));
    struct cap_recorder_stats s;
    dmn_recording_stats(l->recording, &s);
    char where[PATH_MAX];
    if (s.state != CAP_REC_IDLE &&
        dmn_recording_stop(l->recording, where, sizeof where, NULL) != PVX_OK)
        return; /* the error was reported when the take ended */
}

void dmn_live_free(dmn_live **lp)
{
    dmn_live *l = *lp;
    if (l == NULL)
        return;
    cap_capture_free(&l->capture);
    dmn_recording_free(&l->recording);
    dmn_beside_free(&l->beside);
    dmn_publish_close(&l->out);
    dmn_pipeline_free(&l->pipeline);
    dmn_triggers_free(&l->triggers);
    rec_average_free(&l->average);   /* after the pipeline's solver, which uses it */
    dmn_watch_free(&l->watch);       /* after the pipeline, which offers it sets */
    dmn_previews_free(&l->previews); /* likewise */
    dmn_temperature_free(&l->temperature);
    dmn_images_free(&l->images);
    dmn_photometry_free(&l->light);
    dmn_background_free(&l->background);
    dmn_instant_free(&l->instant);
    dmn_compute_close(&l->compute);
    rec_sysmat_free(&l->S);
    dmn_scene_free(&l->scene);
    pvx_pool_free(&l->pool);
    free(l->rig_text);
    rec_rig_fini(&l->rig);
    PVX_FREE(*lp);
}

/* ---- what others ask ---- */

void dmn_live_snapshot(dmn_live *l, struct dmn_state *out)
{
    memset(out, 0, sizeof *out);
    out->uptime_s = (double)(pvx_now_mono() - l->t_start_ns) * 1e-9;
    if (l->open_to != NULL)
        snprintf(out->open_to, sizeof out->open_to, "%s", l->open_to);
    out->keys = l->auth != NULL;
    if (out->keys) {
        out->clients_listed = pvp_auth_clients(l->auth);
        out->connections_refused = pvp_auth_refused(l->auth);
    }
    out->session = l->out.start.session;
    dmn_pipeline_counts(l->pipeline, out);
    dmn_pipeline_draws(l->pipeline, &out->draws);
    dmn_pipeline_compute(l->pipeline, &out->compute);
    dmn_publish_state(&l->out, out);
    cap_capture_stats(l->capture, &out->capture);
    dmn_recording_stats(l->recording, &out->record);
    if (dmn_recording_ring(l->recording) != NULL)
        cap_ring_stats(dmn_recording_ring(l->recording), &out->ring);
    dmn_triggers_state(l->triggers, &out->triggers);
    dmn_beside_state(l->beside, &out->volumes);
    out->spread_p50_ms = (double)pvx_hist_quantile(&out->capture.spread, 0.5) * 1e-6;
    out->spread_p99_ms = (double)pvx_hist_quantile(&out->capture.spread, 0.99) * 1e-6;
    for (int a = 0; a < 3; a++)
        out->voxels[a] = l->rig.grid.n[a];
    out->binning = l->S->binning;
    out->rays = l->S->rays_per_bin;
    out->matrix_entries = l->S->nnz;
    out->nch = dmn_config_channels(&l->cfg);
    out->n_cameras = l->rig.n_cameras;
    for (size_t c = 0; c < out->n_cameras; c++)
        snprintf(out->camera[c], sizeof out->camera[c], "%s", l->rig.cameras[c].name);
    dmn_images_counts(l->images, out->images);
    dmn_watch_state(l->watch, out);
    dmn_previews_state(l->previews, out);
    dmn_temperature_state(l->temperature, out);
}

pvx_err dmn_live_record(dmn_live *l, bool start, const char *path, char *where, size_t size,
                        struct pvx_diag *d)
{
    return start ? dmn_recording_start(l->recording, path, where, size, d)
                 : dmn_recording_stop(l->recording, where, size, d);
}

pvx_err dmn_live_trigger(dmn_live *l, const char *name, int64_t *t_ns, struct pvx_diag *d)
{
    return dmn_triggers_order(l->triggers, name, t_ns, d);
}

pvx_err dmn_live_check_begin(dmn_live *l, struct pvx_diag *d)
{
    return dmn_watch_ask(l->watch, d);
}

void dmn_live_check_state(dmn_live *l, struct dmn_check_request *out)
{
    static struct dmn_state s; /* large; of one thread at a time */
    memset(out, 0, sizeof *out);
    if (l->watch == NULL)
        return;
    dmn_watch_asked(l->watch, out);
    dmn_publish_state(&l->out, &s);
    out->found.verdict.residual = s.report.solve.rel_residual;
    out->found.verdict.noise = rec_frame_noise(&s.report, dmn_config_channels(&l->cfg));
}

static void live_health(void *ctx, uint32_t camera, struct cap_health *out)
{
    cap_capture_health(((dmn_live *)ctx)->capture, camera, out);
}

/* Owner: caller, free(); NULL: out of memory. */
static char *status_text(dmn_live *l)
{
    struct dmn_state *s = pvx_calloc(1, sizeof *s);
    char *text = malloc(DMN_STATE_JSON_MAX);
    if (s != NULL && text != NULL)
        dmn_live_snapshot(l, s);
    if (s == NULL || text == NULL || dmn_state_json(s, text, DMN_STATE_JSON_MAX) == 0)
        PVX_FREE(text);
    free(s);
    return text;
}

pvx_err dmn_live_keep(dmn_live *l, const struct dmn_config *c, const char *path, char *where,
                      size_t size, struct pvx_diag *d)
{
    struct dmn_instant_about about = {.start = l->out.start,
                                      .keep_free_bytes = (uint64_t)(c->record_keep_free_gb * 1e9),
                                      .health = live_health,
                                      .ctx = l};
    struct dmn_instant_got got;
    PVX_TRY(dmn_recording_snapshot(l->recording, path, where, size, &about.head, d));
    PVX_TRY(dmn_instant_place(where, d));
    pthread_mutex_lock(&l->out.lock);
    size_t voxels = l->out.report.active_voxels;
    pthread_mutex_unlock(&l->out.lock);
    PVX_TRY(dmn_instant_take(l->instant, 2 * voxels, &got, d));
    char *config = dmn_config_format(c), *status = status_text(l);
    about.head.config = config;
    about.status = status;
    pvx_err e = config != NULL && status != NULL
                    ? dmn_instant_write(where, &got, &about, d)
                    : pvx_fail(d, PVX_ENOMEM, "no memory for a snapshot");
    free(config);
    free(status);
    dmn_instant_done(l->instant, &got);
    return e;
}

void dmn_live_tune(dmn_live *l, const struct dmn_config *c)
{
    const struct dmn_tuning t = tuning(l, c);
    dmn_pipeline_tune(l->pipeline, &t);
    dmn_images_black(l->images, (float)c->black);
    atomic_store(&l->in.stale_ns, stale_after(c, &t));
    dmn_publish_compress(&l->out, c);
    dmn_temperature_compress(l->temperature, c);
}

pvx_err dmn_live_record_volumes(dmn_live *l, bool start, char *where, size_t size,
                                struct pvx_diag *d)
{
    return start ? dmn_beside_start(l->beside, where, size, d)
                 : dmn_beside_stop(l->beside, where, size, d);
}

pvx_err dmn_live_background(dmn_live *l, uint32_t sets, struct pvx_diag *d)
{
    return dmn_background_begin(l->background, sets, d);
}

void dmn_live_background_state(dmn_live *l, struct dmn_background_state *out)
{
    dmn_background_state(l->background, out);
}

void dmn_live_reset_latency(dmn_live *l)
{
    atomic_store(&l->out.reset_latency, true);
}

int64_t dmn_live_stuck_ns(dmn_live *l)
{
    return dmn_pipeline_stuck_ns(l->pipeline);
}
