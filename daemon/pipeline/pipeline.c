#include "daemon/pipeline/pipeline.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/queue.h"
#include "daemon/pipeline/compute.h"
#include "daemon/pipeline/draws.h"
#include "daemon/pipeline/stage.h"
#include "recon/frame/inside.h"

enum { CARVE, SOLVE, SINK }; /* indices of the stages */

struct dmn_pipeline {
    struct dmn_pipeline_params a;
    rec_carver *carver; /* the carve stage's work areas */
    rec_solver *solver; /* the solve stage's */
    struct dmn_slot slot[DMN_N_SLOTS + DMN_N_AGAIN];
    rec_systems *systems[DMN_N_SYSTEMS + DMN_N_AGAIN];
    rec_bars *bars[DMN_N_SLOTS + DMN_N_AGAIN]; /* of each slot's volume; NULL: none are wanted */
    dmn_draws *draws;                          /* or NULL */
    pvx_queue *idle, *idle_systems, *to_solve, *to_sink;
    struct dmn_stage stage[DMN_N_STAGES];
    _Atomic int64_t waited_ns; /* by the solver, for a set, after its first */
    bool solved;               /* the solver's own: it has had one */
    struct dmn_slot *next; /* waits for a set, then with it for systems; the carve stage's own */
    bool loaded;           /* `next` has a set */

    /* the last volume; belongs to the solve stage */
    struct rec_sparse prev;
    int32_t *prev_index;
    float *prev_value;
    size_t prev_bytes;

    pthread_mutex_t tuning_lock; /* held only to copy; a stage never waits for it */
    struct dmn_tuning tuning;
    atomic_uint tunings;           /* how many came */
    unsigned carve_has, solve_has; /* the one that each stage has taken; the stage's own */

    struct rec_cl
        *card; /* that was asked for; a.frame.card may be NULL, if it failed at the start */
    struct dmn_compute_count compute;
    atomic_uint_fast64_t produced, out, dropped[DMN_N_DROP];
};

/* ---- what changes between sets ---- */

/* A newer tuning than number *has, if there is one. */
static bool newer_tuning(dmn_pipeline *p, unsigned *has, struct dmn_tuning *out)
{
    if (atomic_load(&p->tunings) == *has || pthread_mutex_trylock(&p->tuning_lock) != 0)
        return false;
    *out = p->tuning;
    *has = atomic_load(&p->tunings);
    pthread_mutex_unlock(&p->tuning_lock);
    return true;
}

static void tune_carve(dmn_pipeline *p)
{
    struct dmn_tuning t;
    if (!newer_tuning(p, &p->carve_has, &t))
        return;
    rec_carver_tune(p->carver, &t.photo);
    dmn_draws_outdate(p->draws);
}

static void tune_solve(dmn_pipeline *p)
{
    struct dmn_tuning t;
    if (!newer_tuning(p, &p->solve_has, &t))
        return;
    rec_solver_tune(p->solver, &t.solve);
    p->a.deadline.limit_ns = t.limit_ns;
    p->a.deadline.period_ns = t.period_ns;
    p->a.warm = t.warm;
    if (!t.warm && !p->a.frame.temporal)
        p->prev = (struct rec_sparse){0};
}

void dmn_pipeline_tune(dmn_pipeline *p, const struct dmn_tuning *t)
{
    pthread_mutex_lock(&p->tuning_lock);
    p->tuning = *t;
    atomic_fetch_add(&p->tunings, 1);
    pthread_mutex_unlock(&p->tuning_lock);
}

/* ---- slots ---- */

/* Both queues have as many places as things: putting back never displaces. */
static void give_systems_back(dmn_pipeline *p, struct dmn_slot *s)
{
    rec_systems *y = rec_frame_give_back(s->frame);
    void *gone;
    if (y != NULL)
        pvx_queue_put(p->idle_systems, y, &gone);
}

static void pipeline_give_back(dmn_pipeline *p, struct dmn_slot *s)
{
    void *gone;
    dmn_draws_cancel(p->draws, s);
    give_systems_back(p, s);
    rec_frame_reset(s->frame);
    pvx_queue_put(p->idle, s, &gone);
}

static void pipeline_drop(dmn_pipeline *p, struct dmn_slot *s, enum dmn_drop why)
{
    atomic_fetch_add(&p->dropped[why], 1);
    pipeline_give_back(p, s);
}

/* Hand a slot on.  Live: drop a set without a volume, and the oldest set if the queue is full.  Lossless: wait for
 * room. */
static void hand_on(dmn_pipeline *p, pvx_queue *q, struct dmn_slot *s, enum dmn_drop displaced)
{
    void *gone = NULL;
    if (!p->a.lossless && s->why != DMN_N_DROP) {
        pipeline_drop(p, s, s->why);
        return;
    }
    if (!p->a.lossless) {
        pvx_queue_put(q, s, &gone);
        if (gone == s)
            displaced = DMN_DROP_STOPPED;
    } else if (pvx_queue_put_wait(q, s) != PVX_OK) {
        gone = s;
        displaced = DMN_DROP_STOPPED;
    }
    if (gone != NULL)
        pipeline_drop(p, gone, displaced);
}

/* ---- source and carve ---- */

/* A slot with the next set in p->next, if it has none yet.  PVX_ETIMEDOUT: none yet, or lossless, all slots are in
 * use. */
static pvx_err load_next(dmn_pipeline *p)
{
    void *item;
    if (p->loaded)
        return PVX_OK;
    if (p->next == NULL) {
        PVX_TRY(pvx_queue_pop(p->idle, DMN_STAGE_WAIT_NS, &item));
        p->next = item;
    }
    struct dmn_slot *s = p->next;
    *s = (struct dmn_slot){.frame = s->frame, .why = DMN_N_DROP};
    PVX_TRY(p->a.source.next(p->a.source.ctx, s));
    atomic_fetch_add(&p->produced, 1 + s->passed_over);
    atomic_fetch_add(&p->dropped[DMN_DROP_STALE], s->passed_over);
    p->loaded = true;
    return PVX_OK;
}

static bool carve(void *ctx)
{
    dmn_pipeline *p = ctx;
    void *item;
    pvx_err e = load_next(p);
    if (e == PVX_ETIMEDOUT)
        return true;
    if (e != PVX_OK) {
        pvx_queue_close(p->to_solve);
        return false;
    }
    struct dmn_slot *s = p->next;
    if (s->why == DMN_N_DROP) {
        if (pvx_queue_pop(p->idle_systems, DMN_STAGE_WAIT_NS, &item) != PVX_OK)
            return true; /* lossless: the solver has not yet ended */
        rec_frame_lend(s->frame, item);
    }
    p->next = NULL;
    p->loaded = false;
    int64_t t0 = pvx_now_mono();
    if (s->why == DMN_N_DROP) {
        tune_carve(p);
        rec_frame_carve(s->frame);
        dmn_draws_carved(p->draws, s);
        if (p->a.carved != NULL)
            p->a.carved(p->a.carved_ctx, s);
        pvx_hist_add(&p->stage[CARVE].busy, pvx_now_mono() - t0 + s->bin_ns);
    }
    hand_on(p, p->to_solve, s, DMN_DROP_SOLVE);
    return true;
}

/* ---- solve ---- */

static void pipeline_remember(dmn_pipeline *p, const struct dmn_slot *s)
{
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    memcpy(p->prev_index, v.index, (size_t)v.n * sizeof *v.index);
    memcpy(p->prev_value, v.value, (size_t)v.n * (size_t)v.cs * sizeof *v.value);
    p->prev = v;
    p->prev.index = p->prev_index;
    p->prev.value = p->prev_value;
}

/* After the solve, with the systems that it used. */
static pvx_err solve_bars(dmn_pipeline *p, struct dmn_slot *s)
{
    rec_bars *b = p->bars[s - p->slot];
    return b != NULL ? rec_frame_bars(s->frame, b, s->set, &s->bars) : PVX_OK;
}

static void solve_slot(dmn_pipeline *p, struct dmn_slot *s)
{
    int64_t t0 = pvx_now_mono();
    tune_solve(p);
    int64_t until = dmn_deadline_at(&p->a.deadline, p->a.lossless ? t0 : s->t_last_mono_ns, t0);
    pvx_err e = rec_frame_solve(s->frame, until, p->prev.grid != NULL ? &p->prev : NULL);
    PVX_THEN(e, solve_bars(p, s));
    if (e != PVX_OK) {
        LOG_EVERY_ABOUT(
            PVX_LOG_ERROR, RECON, ABOUT(.cause = "not_solved", .of_set = true, .set = s->set),
            "set %llu cannot be solved: %s", (unsigned long long)s->set, pvx_strerror(e));
        s->why = DMN_DROP_FAILED;
        return;
    }
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    dmn_compute_note(&p->compute, p->card, r);
    dmn_deadline_learn(&p->a.deadline, r->solve.status == REC_DEADLINE,
                       r->coarse_iterations + r->solve.iterations, r->solve.iterations);
    if (p->a.warm || p->a.frame.temporal)
        pipeline_remember(p, s);
    pvx_hist_add(&p->stage[SOLVE].busy, pvx_now_mono() - t0);
}

/* Whether the set, which was solved, is solved once more after it went out. */
static bool pipeline_again(dmn_pipeline *p, struct dmn_slot *s)
{
    const struct dmn_draws_load load = {.waiting = pvx_queue_length(p->to_solve) > 0,
                                        .dropped = atomic_load(&p->dropped[DMN_DROP_STALE]) +
                                                   atomic_load(&p->dropped[DMN_DROP_SOLVE]) +
                                                   atomic_load(&p->dropped[DMN_DROP_PUBLISH]),
                                        .waited_ns = atomic_load(&p->waited_ns),
                                        .now_ns = pvx_now_mono()};
    return dmn_draws_offer(p->draws, s, &load);
}

static bool pipeline_solve(void *ctx)
{
    dmn_pipeline *p = ctx;
    void *item;
    int64_t t0 = pvx_now_mono();
    pvx_err e = pvx_queue_pop(p->to_solve, DMN_STAGE_WAIT_NS, &item);
    if (e != PVX_ECLOSED && p->solved)
        atomic_fetch_add(&p->waited_ns, pvx_now_mono() - t0);
    if (e == PVX_ETIMEDOUT)
        return true;
    if (e != PVX_OK) {
        pvx_queue_close(p->to_sink);
        return false;
    }
    struct dmn_slot *s = item;
    p->solved = true;
    if (s->why == DMN_N_DROP)
        solve_slot(p, s);
    if (s->why != DMN_N_DROP || !pipeline_again(p, s))
        give_systems_back(p, s);
    hand_on(p, p->to_sink, s, DMN_DROP_PUBLISH);
    return true;
}

/* ---- sink ---- */

/* A set that was solved once more. */
static void pipeline_done_again(void *ctx, struct dmn_slot *s)
{
    pipeline_give_back(ctx, s);
}

static bool sink(void *ctx)
{
    dmn_pipeline *p = ctx;
    const struct dmn_sink *to = &p->a.sink;
    void *item;
    pvx_err e = pvx_queue_pop(p->to_sink, DMN_STAGE_WAIT_NS, &item);
    if (e == PVX_OK) {
        struct dmn_slot *s = item;
        int64_t t0 = pvx_now_mono();
        if (s->why == DMN_N_DROP)
            dmn_draws_bars(p->draws, s);
        if (to->put(to->ctx, s)) {
            pvx_hist_add(&p->stage[SINK].busy, pvx_now_mono() - t0);
            atomic_fetch_add(&p->out, 1);
            if (s->again)
                dmn_draws_take(p->draws, s);
            else
                pipeline_give_back(p, s);
        } else {
            pipeline_drop(p, s, s->why == DMN_N_DROP ? DMN_DROP_FAILED : s->why);
        }
    }
    if (to->tick != NULL)
        to->tick(to->ctx);
    if (e == PVX_ECLOSED && to->end != NULL)
        to->end(to->ctx);
    return e != PVX_ECLOSED;
}

/* ---- start and stop ---- */

static pvx_err pipeline_build(dmn_pipeline *p, struct pvx_diag *d)
{
    const struct dmn_pipeline_params *a = &p->a;
    size_t waiting = a->waiting < 1 ? 1 : a->waiting, again = a->draws ? DMN_N_AGAIN : 0,
           slots = DMN_N_SLOTS - DMN_WAITING_MAX + waiting + again;
    PVX_TRY(pvx_queue_new(DMN_N_SLOTS + DMN_N_AGAIN, &p->idle));
    PVX_TRY(pvx_queue_new(DMN_N_SYSTEMS + DMN_N_AGAIN, &p->idle_systems));
    PVX_TRY(pvx_queue_new(waiting, &p->to_solve));
    PVX_TRY(pvx_queue_new(1, &p->to_sink));
    PVX_TRY(rec_carver_new(a->S, a->rig, &a->frame, a->pool, &p->carver, d));
    for (size_t c = 0; a->background != NULL && c < a->rig->n_cameras; c++)
        PVX_TRY(rec_carver_background(p->carver, c, a->background[c]));
    PVX_TRY(rec_solver_new(a->S, &a->frame, &p->solver, d));
    rec_solver_average(p->solver, a->average);
    for (size_t i = 0; i < (a->lossless ? DMN_N_SLOTS_LOSSLESS : slots); i++) {
        PVX_TRY(rec_frame_new_bare(p->carver, p->solver, &p->slot[i].frame, d));
        if (a->bars > 0)
            PVX_TRY(rec_bars_new(a->S, a->frame.nch, a->bars, &p->bars[i], d));
        pipeline_give_back(p, &p->slot[i]);
    }
    if (a->draws)
        PVX_TRY(dmn_draws_new(a, pipeline_done_again, p, &p->draws, d));
    for (size_t i = 0; i < (a->lossless ? DMN_N_SYSTEMS_LOSSLESS : 2 + waiting + again); i++) {
        void *gone;
        PVX_TRY(rec_systems_new(p->carver, p->solver, &p->systems[i], d));
        pvx_queue_put(p->idle_systems, p->systems[i], &gone);
    }
    /* Reserve it even if no solve starts warm: a tuning may change that, and unused pages cost nothing. */
    size_t n = rec_grid_count(&a->S->grid);
    p->prev_bytes = n * (sizeof(int32_t) + 4 * sizeof(float));
    p->prev_value = pvx_reserve(p->prev_bytes);
    if (p->prev_value == NULL)
        return PVX_ENOMEM;
    p->prev_index = (int32_t *)(p->prev_value + 4 * n);
    return PVX_OK;
}

/* Frees what pipeline_build has made, so that it can be called again. */
static void pipeline_clear(dmn_pipeline *p)
{
    for (size_t i = 0; i < DMN_N_SLOTS + DMN_N_AGAIN; i++) {
        rec_frame_free(&p->slot[i].frame);
        rec_bars_free(&p->bars[i]);
    }
    dmn_draws_free(&p->draws);
    for (size_t i = 0; i < DMN_N_SYSTEMS + DMN_N_AGAIN; i++)
        rec_systems_free(&p->systems[i]);
    rec_carver_free(&p->carver);
    rec_solver_free(&p->solver);
    pvx_queue_free(&p->idle);
    pvx_queue_free(&p->idle_systems);
    pvx_queue_free(&p->to_solve);
    pvx_queue_free(&p->to_sink);
    if (p->prev_value != NULL)
        pvx_unreserve(p->prev_value, p->prev_bytes);
    p->prev_value = NULL;
}

/* A card that fails now is no reason not to start. */
static pvx_err pipeline_build_here(dmn_pipeline *p, pvx_err e, struct pvx_diag *d)
{
    dmn_compute_fail(&p->compute, p->card, pvx_diag_text(d, e));
    pipeline_clear(p);
    p->a.frame.card = NULL;
    if (d != NULL)
        d->text[0] = '\0';
    return pipeline_build(p, d);
}

pvx_err dmn_pipeline_new(const struct dmn_pipeline_params *params, dmn_pipeline **out,
                         struct pvx_diag *d)
{
    dmn_pipeline *p = *out = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    p->a = *params;
    p->a.frame.again = params->bars > 0 || params->draws;
    pthread_mutex_init(&p->tuning_lock, NULL);
    pthread_mutex_init(&p->compute.lock, NULL);
    p->card = params->frame.card;
    pvx_err e = pipeline_build(p, d);
    if (e != PVX_OK && p->card != NULL)
        e = pipeline_build_here(p, e, d);
    if (e != PVX_OK)
        dmn_pipeline_free(out);
    return e;
}

void dmn_pipeline_background(dmn_pipeline *p, size_t camera, float **bg)
{
    rec_carver_exchange_background(p->carver, camera, bg);
    dmn_draws_outdate(p->draws);
}

pvx_err dmn_pipeline_start(dmn_pipeline *p, struct pvx_diag *d)
{
    pvx_err e = p->draws != NULL ? dmn_draws_start(p->draws) : PVX_OK;
    PVX_THEN(e, dmn_stage_start(&p->stage[SINK], p->a.sink.name, sink, p));
    PVX_THEN(e, dmn_stage_start(&p->stage[SOLVE], "solve", pipeline_solve, p));
    PVX_THEN(e, dmn_stage_start(&p->stage[CARVE], "carve", carve, p));
    return e == PVX_OK ? e : pvx_fail(d, e, "no thread to be had for a stage of the pipeline");
}

bool dmn_pipeline_finished(dmn_pipeline *p)
{
    return atomic_load(&p->stage[SINK].done);
}

void dmn_pipeline_join(dmn_pipeline *p)
{
    /* after a start that failed half-way, no stage closes these queues */
    if (!p->stage[CARVE].started)
        pvx_queue_close(p->to_solve);
    if (!p->stage[SOLVE].started)
        pvx_queue_close(p->to_sink);
    for (int i = 0; i < DMN_N_STAGES; i++)
        dmn_stage_join(&p->stage[i]);
    dmn_draws_join(p->draws);
}

void dmn_pipeline_free(dmn_pipeline **pp)
{
    dmn_pipeline *p = *pp;
    if (p == NULL)
        return;
    pipeline_clear(p);
    pthread_mutex_destroy(&p->tuning_lock);
    pthread_mutex_destroy(&p->compute.lock);
    PVX_FREE(*pp);
}

/* ---- what others ask ---- */

static double pipeline_to_ms(int64_t ns)
{
    return (double)ns * 1e-6;
}

static void stage_state(const struct dmn_stage *s, const char *name, pvx_queue *in,
                        struct dmn_stage_state *out)
{
    snprintf(out->name, sizeof out->name, "%s", name);
    /* the stage counts meanwhile: each number is read whole, but they may be one item apart */
    out->items = __atomic_load_n(&s->busy.count, __ATOMIC_RELAXED);
    int64_t sum = __atomic_load_n(&s->busy.sum_ns, __ATOMIC_RELAXED);
    out->mean_ms = out->items == 0 ? 0 : pipeline_to_ms(sum) / (double)out->items;
    out->p99_ms = pipeline_to_ms(pvx_hist_quantile(&s->busy, 0.99));
    out->max_ms = pipeline_to_ms(__atomic_load_n(&s->busy.max_ns, __ATOMIC_RELAXED));
    out->beat_age_s = (double)(pvx_now_mono() - atomic_load(&s->beat_ns)) * 1e-9;
    out->queued = in == NULL ? 0 : pvx_queue_length(in);
}

void dmn_pipeline_counts(dmn_pipeline *p, struct dmn_state *out)
{
    pvx_queue *const in[DMN_N_STAGES] = {NULL, p->to_solve, p->to_sink};
    const char *const name[DMN_N_STAGES] = {"carve", "solve", p->a.sink.name};
    /* what went out is read before what came in, so that `inside` is never negative */
    uint64_t gone = out->published = atomic_load(&p->out);
    for (int i = 0; i < DMN_N_DROP; i++)
        gone += out->dropped[i] = atomic_load(&p->dropped[i]);
    out->produced = atomic_load(&p->produced);
    out->inside = out->produced - gone;
    for (int i = 0; i < DMN_N_STAGES; i++)
        stage_state(&p->stage[i], name[i], in[i], &out->stage[i]);
}

void dmn_pipeline_compute(dmn_pipeline *p, struct dmn_compute_state *out)
{
    dmn_compute_state(&p->compute, p->card, out);
}

void dmn_pipeline_draws(dmn_pipeline *p, struct dmn_draws_state *out)
{
    dmn_draws_state(p->draws, out);
}

int64_t dmn_pipeline_waited_ns(dmn_pipeline *p)
{
    return atomic_load(&p->waited_ns);
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
