#include "daemon/pipeline.h"

#include <limits.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/pool.h"
#include "base/queue.h"
#include "daemon/config/endpoints.h"
#include "daemon/pipeline/recording.h"
#include "daemon/images.h"
#include "daemon/pipeline/scene.h"
#include "daemon/pipeline/sources.h"
#include "daemon/pipeline/stage.h"
#include "proto/pub.h"

#define WAIT_SUBSCRIBER_NS (20 * PVX_NS_PER_MS)
#define STATUS_EVERY_NS    PVX_NS_PER_S
#define ITERATIONS_FEW     2 /* fewer than that is not a solution, not even from a warm start */
#define PATIENCE_MAX       8

enum { CARVE, SOLVE, PUBLISH }; /* indices of the stages */
static const char *const stage_names[DMN_N_STAGES] = {"carve", "solve", "publish"};

/* One frame set on its way; who holds the pointer owns it. */
struct slot {
    rec_frame *frame;
    uint64_t set;
    int64_t t_exposure_ns, spread_ns, t_last_mono_ns;
    uint32_t n_present;
    uint64_t mask;
};

struct dmn_pipeline {
    struct dmn_config cfg;
    struct rec_rig rig;
    pvx_pool *pool;
    rec_sysmat *S;
    dmn_scene *scene;
    cap_capture *capture;
    dmn_images *images;
    struct dmn_sources sources;
    dmn_recording *recording; /* NULL = cannot */
    pvp_pub *pub;
    struct pvp_start start;
    int nch;
    atomic_size_t subscribers;
    bool warm;
    int64_t deadline_ns, period_ns;

    struct slot slot[DMN_N_SLOTS];
    pvx_queue *idle, *to_solve, *to_publish;
    struct dmn_stage stage[DMN_N_STAGES];
    atomic_bool stopping;
    char end_reason[PVP_REASON_MAX];

    int patience; /* periods that a solve may take; belongs to the solve stage */
    /* warm start: a copy of the last volume; belongs to the solve stage */
    int32_t *prev_index;
    float *prev_value;
    size_t prev_bytes;
    struct rec_sparse prev;

    atomic_uint_fast64_t produced, published, dropped[DMN_N_DROP];
    atomic_bool reset_latency;
    int64_t t_start_ns;

    /* publish stage's own */
    int64_t next_status_ns, rate_t_ns;
    uint64_t rate_n;
    struct dmn_state status;
    char status_json[DMN_STATE_JSON_MAX];

    pthread_mutex_t lock; /* what publish leaves for snapshots */
    struct pvx_hist latency;
    struct rec_frame_report report;
    uint64_t last_set, bytes;
    int64_t last_exposure_ns;
    double sets_per_s;
};

/* ---- slots ---- */

static void give_back(dmn_pipeline *p, struct slot *s)
{
    rec_frame_reset(s->frame);
    void *gone;
    pvx_queue_put(p->idle, s, &gone); /* as many places as slots: never displaces */
}

static void drop(dmn_pipeline *p, struct slot *s, enum dmn_drop why)
{
    atomic_fetch_add(&p->dropped[why], 1);
    give_back(p, s);
}

/* Hand a slot on.  Live, the oldest goes when there is no room; lossless, wait for room. */
static void hand_on(dmn_pipeline *p, pvx_queue *q, struct slot *s, enum dmn_drop why)
{
    void *gone = NULL;
    if (!p->cfg.lossless) {
        pvx_queue_put(q, s, &gone);
        if (gone == s)
            why = DMN_DROP_STOPPED;
    } else if (pvx_queue_put_wait(q, s) != PVX_OK) {
        gone = s;
        why = DMN_DROP_STOPPED;
    }
    if (gone != NULL)
        drop(p, gone, why);
}

/* ---- carve ---- */

/* How many cameras' images a set must have to be solved. */
static uint32_t images_needed(const dmn_pipeline *p, const struct cap_set *set)
{
    const struct cap_assembler_params *sets = &p->sources.capture.sets;
    bool all = sets->policy == CAP_POLICY_DROP || set->n < sets->min_cameras;
    return all ? set->n : sets->min_cameras;
}

/* Live, a set that is too old makes way for a newer one if there is one. */
static struct cap_set *newest(dmn_pipeline *p, struct cap_set *set)
{
    while (!p->cfg.lossless && p->deadline_ns > 0 &&
           pvx_now_mono() - set->t_last_mono_ns > p->deadline_ns) {
        struct cap_set *next;
        if (cap_capture_next(p->capture, 0, &next) != PVX_OK)
            break;
        atomic_fetch_add(&p->produced, 1);
        atomic_fetch_add(&p->dropped[DMN_DROP_STALE], 1);
        cap_set_release(set);
        set = next;
    }
    return set;
}

static bool carve(void *ctx)
{
    dmn_pipeline *p = ctx;
    struct cap_set *set;
    if (p->cfg.wait_subscriber && !atomic_load(&p->stopping)) {
        if (atomic_load(&p->subscribers) == 0) {
            pvx_sleep_until_mono(pvx_now_mono() + WAIT_SUBSCRIBER_NS);
            return true;
        }
        p->cfg.wait_subscriber = false; /* from now on it is the subscribers' affair */
    }
    pvx_err e = cap_capture_next(p->capture, DMN_STAGE_WAIT_NS, &set);
    if (e == PVX_ETIMEDOUT)
        return true;
    if (e != PVX_OK) {
        pvx_queue_close(p->to_solve);
        return false;
    }
    atomic_fetch_add(&p->produced, 1);
    set = newest(p, set);
    void *item;
    while (pvx_queue_take(p->idle, DMN_STAGE_WAIT_NS, &item) == PVX_ETIMEDOUT)
        atomic_store(&p->stage[CARVE].beat_ns, pvx_now_mono()); /* lossless: held back, not stuck */
    struct slot *s = item;
    int64_t t0 = pvx_now_mono();
    s->set = set->number;
    s->t_exposure_ns = set->t_exposure_ns;
    s->spread_ns = set->spread_ns;
    s->t_last_mono_ns = set->t_last_mono_ns;
    s->n_present = dmn_images_bin(p->images, set, s->frame, &s->mask);
    uint32_t needed = images_needed(p, set);
    cap_set_release(set);
    if (s->n_present == 0 || s->n_present < needed) {
        drop(p, s, DMN_DROP_IMAGES);
        return true;
    }
    rec_frame_carve(s->frame);
    pvx_hist_add(&p->stage[CARVE].busy, pvx_now_mono() - t0);
    hand_on(p, p->to_solve, s, DMN_DROP_SOLVE);
    return true;
}

/* ---- solve ---- */

static void remember(dmn_pipeline *p, const struct slot *s)
{
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    memcpy(p->prev_index, v.index, (size_t)v.n * sizeof *v.index);
    memcpy(p->prev_value, v.value, (size_t)v.n * (size_t)v.cs * sizeof *v.value);
    p->prev = v;
    p->prev.index = p->prev_index;
    p->prev.value = p->prev_value;
}

/* When the solver has to come back, mono clock.  Live, it may not take longer than keeps up, nor
 * less than half a period however late its set came.  Where that does not buy a solution (another
 * program has the processors), it gets more, up to PATIENCE_MAX periods: then sets are dropped, but
 * those that are published are solved. */
static int64_t solve_until(const dmn_pipeline *p, const struct slot *s, int64_t now)
{
    int64_t until = s->t_last_mono_ns + p->deadline_ns;
    if (p->cfg.deadline_ms >= 0 || p->cfg.lossless)
        return until;
    int64_t most = now + p->period_ns * p->patience * 9 / 10;
    int64_t least = now + p->period_ns * p->patience / 2;
    return p->patience > 1 || until > most ? most : until < least ? least : until;
}

static void learn_patience(dmn_pipeline *p, const struct rec_frame_report *f)
{
    const struct rec_solve_report *r = &f->solve;
    if (r->status == REC_DEADLINE && f->coarse_iterations + r->iterations < ITERATIONS_FEW)
        p->patience = p->patience * 2 > PATIENCE_MAX ? PATIENCE_MAX : p->patience * 2;
    else if (p->patience > 1 && (r->status != REC_DEADLINE || r->iterations > 3 * ITERATIONS_FEW))
        p->patience--;
}

static bool solve(void *ctx)
{
    dmn_pipeline *p = ctx;
    void *item;
    pvx_err e = pvx_queue_take(p->to_solve, DMN_STAGE_WAIT_NS, &item);
    if (e == PVX_ETIMEDOUT)
        return true;
    if (e != PVX_OK) {
        pvx_queue_close(p->to_publish);
        return false;
    }
    struct slot *s = item;
    int64_t t0 = pvx_now_mono(), deadline = 0;
    if (p->deadline_ns > 0)
        deadline = solve_until(p, s, t0);
    e = rec_frame_solve(s->frame, deadline, p->prev.grid != NULL ? &p->prev : NULL);
    if (e != PVX_OK) {
        LOG_EVERY(PVX_LOG_ERROR, RECON, "set %llu cannot be solved: %s", (unsigned long long)s->set,
                  pvx_strerror(e));
        drop(p, s, DMN_DROP_FAILED);
        return true;
    }
    learn_patience(p, rec_frame_get_report(s->frame));
    if (p->warm)
        remember(p, s);
    pvx_hist_add(&p->stage[SOLVE].busy, pvx_now_mono() - t0);
    hand_on(p, p->to_publish, s, DMN_DROP_PUBLISH);
    return true;
}

/* ---- publish ---- */

static void fill_report(const struct rec_frame_report *r, struct pvp_report *out)
{
    *out = (struct pvp_report){.status = (uint32_t)r->solve.status,
                               .iterations = r->solve.iterations,
                               .rel_residual = r->solve.rel_residual,
                               .active_voxels = (uint32_t)r->active_voxels,
                               .active_rays = (uint32_t)r->active_rays,
                               .entries = r->entries,
                               .photometry_ns = r->photo_ns,
                               .hull_ns = r->hull_ns,
                               .restrict_ns = r->restrict_ns,
                               .solve_ns = r->solve_ns,
                               .total_ns = r->photo_ns + r->hull_ns + r->restrict_ns + r->solve_ns};
    snprintf(out->solver, sizeof out->solver, "%s", r->solve.solver);
}

static void publish_slot(dmn_pipeline *p, struct slot *s)
{
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    int64_t t0 = pvx_now_mono();
    struct pvp_volume m = {.session = p->start.session,
                           .set = s->set,
                           .t_exposure_ns = s->t_exposure_ns,
                           .t_publish_ns = pvx_now_real(),
                           .spread_ns = s->spread_ns,
                           .latency_ns = t0 - s->t_last_mono_ns,
                           .cameras_present = s->n_present,
                           .camera_mask = s->mask,
                           .grid = p->start.grid};
    fill_report(r, &m.report);
    size_t bytes = 0;
    pvx_err e = pvp_pub_volume(p->pub, &m, (uint32_t)v.n, v.index, v.value, v.cs, &bytes);
    int64_t t1 = pvx_now_mono();
    if (e != PVX_OK) {
        LOG_EVERY(PVX_LOG_ERROR, PROTO, "set %llu cannot be published: %s",
                  (unsigned long long)s->set, pvx_strerror(e));
        drop(p, s, DMN_DROP_FAILED);
        return;
    }
    pvx_hist_add(&p->stage[PUBLISH].busy, t1 - t0);
    pthread_mutex_lock(&p->lock);
    if (atomic_exchange(&p->reset_latency, false))
        p->latency = (struct pvx_hist){0};
    pvx_hist_add(&p->latency, t1 - s->t_last_mono_ns);
    p->report = *r;
    p->last_set = s->set;
    p->last_exposure_ns = s->t_exposure_ns;
    p->bytes = bytes;
    pthread_mutex_unlock(&p->lock);
    atomic_fetch_add(&p->published, 1);
    give_back(p, s);
}

/* Once a second: the rate, the status message, the repeated start message. */
static void every_second(dmn_pipeline *p)
{
    pvp_pub_tick(p->pub);
    atomic_store(&p->subscribers, pvp_pub_subscribers(p->pub));
    int64_t now = pvx_now_mono();
    if (now < p->next_status_ns)
        return;
    p->next_status_ns = now + STATUS_EVERY_NS;
    uint64_t n = atomic_load(&p->published);
    pthread_mutex_lock(&p->lock);
    p->sets_per_s = (double)(n - p->rate_n) / ((double)(now - p->rate_t_ns) * 1e-9);
    pthread_mutex_unlock(&p->lock);
    p->rate_n = n;
    p->rate_t_ns = now;
    dmn_pipeline_snapshot(p, &p->status);
    if (dmn_state_json(&p->status, p->status_json, sizeof p->status_json) == 0)
        return;
    pvx_err e = pvp_pub_status(p->pub, p->status_json);
    if (e != PVX_OK)
        LOG_EVERY(PVX_LOG_WARN, PROTO, "status not published: %s", pvx_strerror(e));
}

static bool publish(void *ctx)
{
    dmn_pipeline *p = ctx;
    void *item;
    pvx_err e = pvx_queue_take(p->to_publish, DMN_STAGE_WAIT_NS, &item);
    if (e == PVX_OK)
        publish_slot(p, item);
    every_second(p);
    if (e != PVX_ECLOSED)
        return true;
    const char *why = atomic_load(&p->stopping) ? p->end_reason : "end of the recording";
    e = pvp_pub_end(p->pub, why);
    if (e != PVX_OK)
        LOG_W(PROTO, "end not published: %s", pvx_strerror(e));
    return false;
}

/* ---- start and stop ---- */

static pvx_err slots_new(dmn_pipeline *p, struct pvx_diag *d)
{
    struct rec_frame_params fp;
    dmn_config_frame(&p->cfg, &fp);
    p->nch = fp.nch;
    PVX_TRY(pvx_queue_new(DMN_N_SLOTS, &p->idle));
    PVX_TRY(pvx_queue_new(1, &p->to_solve));
    PVX_TRY(pvx_queue_new(1, &p->to_publish));
    for (size_t i = 0; i < DMN_N_SLOTS; i++) {
        PVX_TRY(rec_frame_new(p->S, &p->rig, &fp, p->pool, &p->slot[i].frame, d));
        give_back(p, &p->slot[i]);
    }
    p->warm = dmn_config_warm(&p->cfg);
    if (p->warm) {
        size_t n = rec_grid_count(&p->rig.grid);
        p->prev_bytes = n * (sizeof(int32_t) + 4 * sizeof(float));
        p->prev_value = pvx_reserve(p->prev_bytes);
        if (p->prev_value == NULL)
            return PVX_ENOMEM;
        p->prev_index = (int32_t *)(p->prev_value + 4 * n);
    }
    return PVX_OK;
}

static pvx_err publisher_new(dmn_pipeline *p, struct pvx_diag *d)
{
    static const enum pvp_sample samples[] = {PVP_F16, PVP_F32};
    static const enum pvp_compress comps[] = {PVP_RAW, PVP_LZ4, PVP_ZSTD};
    const struct dmn_config *c = &p->cfg;
    const char *endpoint[DMN_TEXTS_MAX] = {dmn_default_endpoint(DMN_VOLUMES)};
    size_t n = c->endpoints.n == 0 ? 1 : c->endpoints.n;
    for (size_t i = 0; i < c->endpoints.n; i++)
        endpoint[i] = c->endpoints.v[i];
    for (size_t i = 0; i < n; i++)
        PVX_TRY(dmn_endpoint_prepare(endpoint[i], d));
    struct pvp_start *s = &p->start;
    const struct rec_grid *g = &p->rig.grid;
    for (int a = 0; a < 3; a++) {
        s->grid.n[a] = (uint32_t)g->n[a];
        s->grid.min[a] = g->min[a];
        s->grid.max[a] = g->max[a];
    }
    s->grid.basis = g->basis == REC_TRILINEAR ? 1 : 0;
    s->grid.channels = (uint32_t)p->nch;
    s->rig_hash = rec_rig_hash(&p->rig);
    s->n_cameras = (uint32_t)p->rig.n_cameras;
    s->fps = c->fps;
    snprintf(s->units, sizeof s->units, "1/m");
    snprintf(s->software, sizeof s->software, "pyrovoxd %s", PVX_VERSION);
    struct pvp_pub_params pp = {.endpoints = endpoint,
                                .n_endpoints = n,
                                .send_hwm = (int)c->hwm,
                                .sample = samples[c->sample],
                                .comp = comps[c->compress],
                                .lossless = c->lossless};
    return pvp_pub_new(&pp, s, &p->pub, d);
}

static pvx_err matrix_open(dmn_pipeline *p, rec_progress_fn progress, void *ctx, struct pvx_diag *d)
{
    struct rec_sysmat_params mp = {.binning = (int32_t)p->cfg.binning,
                                   .rays_per_bin = (int32_t)p->cfg.rays};
    char path[PATH_MAX];
    dmn_config_path(&p->cfg, p->cfg.cache, path, sizeof path);
    int64_t t0 = pvx_now_mono();
    bool cached = false;
    PVX_TRY(rec_sysmat_open(&p->rig, &mp, p->cfg.cache[0] != '\0' ? path : NULL, p->pool, progress,
                            ctx, &p->S, &cached, d));
    LOG_I(RECON,
          "matrix: %zu cameras, %dx%dx%d voxels, binning %d, %d rays per bin side, "
          "%.1f million entries, %s in %.2f s",
          p->S->n_cameras, p->S->grid.n[0], p->S->grid.n[1], p->S->grid.n[2], p->S->binning,
          p->S->rays_per_bin, (double)p->S->nnz * 1e-6, cached ? "read" : "built",
          (double)(pvx_now_mono() - t0) * 1e-9);
    return PVX_OK;
}

/* All that can be wrong in configuration and rig, before anything that takes long. */
static pvx_err prepare(dmn_pipeline *p, struct pvx_diag *d)
{
    const struct dmn_config *c = &p->cfg;
    enum cap_mosaic mosaic;
    PVX_TRY(dmn_config_mosaic(c, &mosaic, d));
    PVX_TRY(dmn_config_rig(c, &p->rig, d));
    p->period_ns = (int64_t)(1 / c->fps * (double)PVX_NS_PER_S);
    p->deadline_ns = dmn_config_deadline(c);
    p->patience = 1;
    PVX_TRY(pvx_pool_new((unsigned)c->threads, "work", &p->pool));
    PVX_TRY(dmn_scene_new(&p->rig, (uint32_t)c->sim_seed, c->sim_period_s, &p->scene));
    PVX_TRY(dmn_sources_init(&p->sources, c, &p->rig, dmn_scene_cap(p->scene), d));
    if (getrandom(&p->start.session, sizeof p->start.session, 0) !=
        (ssize_t)sizeof p->start.session)
        p->start.session = (uint64_t)pvx_now_real();
    PVX_TRY(dmn_recording_new(c, &p->rig, &p->sources, p->start.session, &p->recording, d));
    PVX_TRY(cap_capture_new(&p->sources.capture, &p->capture, d));
    struct rec_sysmat_params mp = {.binning = (int32_t)c->binning,
                                   .rays_per_bin = (int32_t)c->rays};
    return rec_sysmat_resolve(&p->rig, &mp, &mp, d);
}

static pvx_err build(dmn_pipeline *p, rec_progress_fn progress, void *ctx, struct pvx_diag *d)
{
    const struct dmn_config *c = &p->cfg;
    PVX_TRY(prepare(p, d));
    p->nch = dmn_config_channels(c);
    PVX_TRY(publisher_new(p, d));
    PVX_TRY(matrix_open(p, progress, ctx, d));
    struct dmn_images_params ip = {
        .nch = p->nch, .fmt = dmn_config_pixfmt(c), .transfer = (enum cap_transfer)c->transfer};
    PVX_TRY(dmn_config_mosaic(c, &ip.mosaic, d));
    PVX_TRY(dmn_images_new(&ip, p->S, &p->rig, p->pool, &p->images, d));
    return slots_new(p, d);
}

static dmn_pipeline *empty(const struct dmn_config *cfg)
{
    dmn_pipeline *p = pvx_calloc(1, sizeof *p);
    if (p == NULL)
        return NULL;
    p->cfg = *cfg;
    pthread_mutex_init(&p->lock, NULL);
    return p;
}

pvx_err dmn_pipeline_new(const struct dmn_config *cfg, rec_progress_fn progress, void *progress_ctx,
                         dmn_pipeline **out, struct pvx_diag *d)
{
    dmn_pipeline *p = *out = empty(cfg);
    if (p == NULL)
        return PVX_ENOMEM;
    pvx_err e = build(p, progress, progress_ctx, d);
    if (e != PVX_OK)
        dmn_pipeline_free(out);
    return e;
}

pvx_err dmn_pipeline_check(const struct dmn_config *cfg, struct pvx_diag *d)
{
    dmn_pipeline *p = empty(cfg);
    if (p == NULL)
        return PVX_ENOMEM;
    pvx_err e = prepare(p, d);
    dmn_pipeline_free(&p);
    return e;
}

pvx_err dmn_pipeline_start(dmn_pipeline *p, struct pvx_diag *d)
{
    p->t_start_ns = p->rate_t_ns = pvx_now_mono();
    char where[PATH_MAX];
    if (p->cfg.record_mode != 0)
        PVX_TRY(dmn_recording_start(p->recording, NULL, where, sizeof where, d));
    PVX_TRY(cap_capture_start(p->capture, d));
    pvx_err e = dmn_stage_start(&p->stage[PUBLISH], stage_names[PUBLISH], publish, p);
    if (e == PVX_OK)
        e = dmn_stage_start(&p->stage[SOLVE], stage_names[SOLVE], solve, p);
    if (e == PVX_OK)
        e = dmn_stage_start(&p->stage[CARVE], stage_names[CARVE], carve, p);
    return e == PVX_OK ? e : pvx_fail(d, e, "no thread to be had for a stage of the pipeline");
}

bool dmn_pipeline_finished(dmn_pipeline *p)
{
    return atomic_load(&p->stage[PUBLISH].done);
}

void dmn_pipeline_stop(dmn_pipeline *p, const char *reason)
{
    snprintf(p->end_reason, sizeof p->end_reason, "%s", reason);
    atomic_store(&p->stopping, true);
    cap_capture_stop(p->capture); /* carve sees the end, and so do the others in their turn */
    /* a start that failed half-way leaves queues that nobody closes */
    if (!p->stage[CARVE].started)
        pvx_queue_close(p->to_solve);
    if (!p->stage[SOLVE].started)
        pvx_queue_close(p->to_publish);
    for (int i = 0; i < DMN_N_STAGES; i++)
        dmn_stage_join(&p->stage[i]);
    struct cap_recorder_stats s;
    dmn_recording_stats(p->recording, &s);
    char where[PATH_MAX];
    if (s.state != CAP_REC_IDLE &&
        dmn_recording_stop(p->recording, where, sizeof where, NULL) != PVX_OK)
        return; /* it has been said when it ended */
}

void dmn_pipeline_free(dmn_pipeline **pp)
{
    dmn_pipeline *p = *pp;
    if (p == NULL)
        return;
    cap_capture_free(&p->capture);
    dmn_recording_free(&p->recording);
    pvp_pub_free(&p->pub);
    for (size_t i = 0; i < DMN_N_SLOTS; i++)
        rec_frame_free(&p->slot[i].frame);
    pvx_queue_free(&p->idle);
    pvx_queue_free(&p->to_solve);
    pvx_queue_free(&p->to_publish);
    if (p->prev_value != NULL)
        pvx_unreserve(p->prev_value, p->prev_bytes);
    dmn_images_free(&p->images);
    rec_sysmat_free(&p->S);
    dmn_scene_free(&p->scene);
    pvx_pool_free(&p->pool);
    rec_rig_fini(&p->rig);
    pthread_mutex_destroy(&p->lock);
    PVX_FREE(*pp);
}

/* ---- what others ask ---- */

static double to_ms(int64_t ns)
{
    return (double)ns * 1e-6;
}

static void stage_state(dmn_pipeline *p, int i, struct dmn_stage_state *out)
{
    struct dmn_stage *s = &p->stage[i];
    pvx_queue *in = i == SOLVE ? p->to_solve : i == PUBLISH ? p->to_publish : NULL;
    snprintf(out->name, sizeof out->name, "%s", stage_names[i]);
    /* the stage goes on counting meanwhile: each number is whole, the lot may be one item apart */
    out->items = __atomic_load_n(&s->busy.count, __ATOMIC_RELAXED);
    int64_t sum = __atomic_load_n(&s->busy.sum_ns, __ATOMIC_RELAXED);
    out->mean_ms = out->items == 0 ? 0 : to_ms(sum) / (double)out->items;
    out->p99_ms = to_ms(pvx_hist_quantile(&s->busy, 0.99));
    out->max_ms = to_ms(__atomic_load_n(&s->busy.max_ns, __ATOMIC_RELAXED));
    out->beat_age_s = (double)(pvx_now_mono() - atomic_load(&s->beat_ns)) * 1e-9;
    out->queued = in == NULL ? 0 : pvx_queue_length(in);
}

void dmn_pipeline_snapshot(dmn_pipeline *p, struct dmn_state *out)
{
    memset(out, 0, sizeof *out);
    out->uptime_s = (double)(pvx_now_mono() - p->t_start_ns) * 1e-9;
    out->session = p->start.session;
    /* what went out is read before what came in, so that `inside` is never negative */
    uint64_t gone = out->published = atomic_load(&p->published);
    for (int i = 0; i < DMN_N_DROP; i++)
        gone += out->dropped[i] = atomic_load(&p->dropped[i]);
    out->produced = atomic_load(&p->produced);
    out->inside = out->produced - gone;
    pthread_mutex_lock(&p->lock);
    out->sets_per_s = p->sets_per_s;
    out->latency_n = p->latency.count;
    out->latency_p50_ms = to_ms(pvx_hist_quantile(&p->latency, 0.5));
    out->latency_p99_ms = to_ms(pvx_hist_quantile(&p->latency, 0.99));
    out->latency_max_ms = to_ms(p->latency.max_ns);
    out->bytes = p->bytes;
    out->last_set = p->last_set;
    out->last_exposure_ns = p->last_exposure_ns;
    out->report = p->report;
    pthread_mutex_unlock(&p->lock);
    cap_capture_stats(p->capture, &out->capture);
    dmn_recording_stats(p->recording, &out->record);
    out->spread_p50_ms = to_ms(pvx_hist_quantile(&out->capture.spread, 0.5));
    out->spread_p99_ms = to_ms(pvx_hist_quantile(&out->capture.spread, 0.99));
    for (int a = 0; a < 3; a++)
        out->voxels[a] = p->rig.grid.n[a];
    out->binning = p->S->binning;
    out->rays = p->S->rays_per_bin;
    out->matrix_entries = p->S->nnz;
    out->n_cameras = p->rig.n_cameras;
    for (size_t c = 0; c < out->n_cameras; c++)
        snprintf(out->camera[c], sizeof out->camera[c], "%s", p->rig.cameras[c].name);
    dmn_images_counts(p->images, out->images);
    for (int i = 0; i < DMN_N_STAGES; i++)
        stage_state(p, i, &out->stage[i]);
}

pvx_err dmn_pipeline_record(dmn_pipeline *p, bool start, const char *path, char *where, size_t size,
                            struct pvx_diag *d)
{
    return start ? dmn_recording_start(p->recording, path, where, size, d)
                 : dmn_recording_stop(p->recording, where, size, d);
}

void dmn_pipeline_reset_latency(dmn_pipeline *p)
{
    atomic_store(&p->reset_latency, true);
}

int64_t dmn_pipeline_stuck_ns(dmn_pipeline *p)
{
    int64_t now = pvx_now_mono(), worst = 0;
    for (int i = 0; i < DMN_N_STAGES; i++) {
        int64_t age = now - atomic_load(&p->stage[i].beat_ns);
        if (!atomic_load(&p->stage[i].done) && age > worst)
            worst = age;
    }
    return worst;
}
