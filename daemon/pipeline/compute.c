#include "daemon/pipeline/compute.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "daemon/config/compute.h"
#include "daemon/pipeline/compute_check.h"
#include "daemon/pipeline/compute_flame.h"

#define MEASURE_NS (PVX_NS_PER_S / 2) /* that each side may take, after its first set */
#define LEAST_SETS 3

/* ---- which device ---- */

pvx_err dmn_compute_open(const struct dmn_compute_want *w, struct dmn_compute *out,
                         struct pvx_diag *d)
{
    enum dmn_compute_where where;
    const char *name;
    struct pvx_diag why = {""};
    *out = (struct dmn_compute){.card = NULL};
    PVX_TRY(dmn_compute_allowed(w->what, w->word, w->refused, d));
    if (!dmn_compute_parse(w->word, &where, &name) || where == DMN_COMPUTE_CPU)
        return PVX_OK;
    if (w->refused != NULL) {
        snprintf(out->said, sizeof out->said,
                 "compute: the processors, which alone can do this: %s", w->refused);
        return PVX_OK;
    }
    pvx_err e = rec_cl_open(name, &out->card, &why);
    PVX_THEN(e, dmn_compute_check(out->card, &why));
    out->measure = where == DMN_COMPUTE_AUTO;
    if (e == PVX_OK)
        return PVX_OK;
    rec_cl_close(&out->card);
    out->warn = where == DMN_COMPUTE_OPENCL;
    if (where == DMN_COMPUTE_OPENCL && (e == PVX_ENOENT || e == PVX_EUNSUP))
        return pvx_fail(d, e, "%s: %s: %s", w->what, w->word, pvx_diag_text(&why, e));
    snprintf(out->said, sizeof out->said, "compute: the processors; %.600s",
             pvx_diag_text(&why, e));
    return PVX_OK;
}

void dmn_compute_close(struct dmn_compute *c)
{
    rec_cl_close(&c->card);
}

int dmn_compute_leave(int code)
{
    if (!rec_cl_hangs())
        return code;
    fflush(NULL);
    _exit(code);
}

/* ---- what was solved where ---- */

/* A reason without the device's name, with which those of its objects begin. */
static const char *compute_reason(const struct rec_cl *card, const char *why)
{
    const char *name = rec_cl_about(card)->name;
    size_t n = strlen(name);
    return strncmp(why, name, n) == 0 && strncmp(why + n, ": ", 2) == 0 ? why + n + 2 : why;
}

void dmn_compute_fail(struct dmn_compute_count *c, const struct rec_cl *card, const char *why)
{
    why = compute_reason(card, why);
    if (strcmp(c->why, why) == 0)
        return;
    pthread_mutex_lock(&c->lock);
    snprintf(c->why, sizeof c->why, "%s", why);
    pthread_mutex_unlock(&c->lock);
    LOG_ABOUT(PVX_LOG_WARN, RECON, ABOUT(.cause = "compute"),
              "sets are solved on the processors, because of %s: %s", rec_cl_about(card)->name,
              why);
}

void dmn_compute_note(struct dmn_compute_count *c, const struct rec_cl *card,
                      const struct rec_frame_report *r)
{
    if (card == NULL)
        return;
    atomic_fetch_add(r->on_card ? &c->there : &c->here, 1);
    atomic_fetch_add(&c->raw, r->on_card && r->raw_on_card);
    if (!r->on_card && r->why_here[0] != '\0')
        dmn_compute_fail(c, card, r->why_here);
}

void dmn_compute_state(struct dmn_compute_count *c, const struct rec_cl *card,
                       struct dmn_compute_state *out)
{
    *out = (struct dmn_compute_state){.there = 0};
    if (card == NULL)
        return;
    snprintf(out->device, sizeof out->device, "%s", rec_cl_about(card)->name);
    out->there = atomic_load(&c->there);
    out->raw = atomic_load(&c->raw);
    out->here = atomic_load(&c->here);
    pthread_mutex_lock(&c->lock);
    snprintf(out->why, sizeof out->why, "%s", c->why);
    pthread_mutex_unlock(&c->lock);
}

/* ---- a measurement ---- */

static void load_set(const struct dmn_compute_job *job, const dmn_compute_flame *flame, size_t k,
                     rec_frame *f)
{
    rec_frame_reset(f);
    if (job->load != NULL)
        job->load(job->ctx, k, f);
    else
        dmn_compute_flame_load(flame, f);
}

/* A slot of its own, as rec_frame_alone, but with the backgrounds. */
struct bench {
    rec_carver *carver;
    rec_solver *solver;
    rec_frame *frame;
};

static pvx_err bench_new(const struct dmn_compute_job *job, const struct rec_frame_params *p,
                         struct bench *b, struct pvx_diag *d)
{
    *b = (struct bench){NULL, NULL, NULL};
    PVX_TRY(rec_carver_new(job->S, job->rig, p, job->pool, &b->carver, d));
    for (size_t c = 0; job->background != NULL && c < job->rig->n_cameras; c++)
        PVX_TRY(rec_carver_background(b->carver, c, job->background[c]));
    PVX_TRY(rec_solver_new(job->S, p, &b->solver, d));
    return rec_frame_new(b->carver, b->solver, &b->frame, d);
}

static void bench_free(struct bench *b)
{
    rec_frame_free(&b->frame);
    rec_solver_free(&b->solver);
    rec_carver_free(&b->carver);
}

/* Solves sets 0, 1, ... until the time is up, or *sets of them if that is not 0.  The first one is not counted: caches
 * are filled by it, and pages are touched.  PVX_EUNSUP: a set was not solved on p->card. */
static pvx_err bench_run(const struct dmn_compute_job *job, const struct rec_frame_params *p,
                         const dmn_compute_flame *flame, struct bench *b, size_t *sets, double *ms,
                         struct pvx_diag *d)
{
    int64_t spent = 0;
    size_t k = 0, most = *sets > 0 ? *sets : DMN_COMPUTE_SETS;
    for (; k < most; k++) {
        load_set(job, flame, k, b->frame);
        int64_t t0 = pvx_now_mono();
        rec_frame_carve(b->frame);
        PVX_TRY(rec_frame_solve(b->frame, 0, NULL));
        spent += k > 0 ? pvx_now_mono() - t0 : 0;
        const struct rec_frame_report *r = rec_frame_get_report(b->frame);
        if (p->card != NULL && !r->on_card)
            return pvx_fail(d, PVX_EUNSUP, "%s", r->why_here);
        if (*sets == 0 && k >= LEAST_SETS && spent > MEASURE_NS)
            break;
    }
    *sets = k < most ? k + 1 : most;
    *ms = (double)spent * 1e-6 / (double)(*sets - 1);
    return PVX_OK;
}

static pvx_err compute_measure(const struct dmn_compute_job *job, const struct rec_frame_params *p,
                               const dmn_compute_flame *flame, size_t *sets, double *ms,
                               struct pvx_diag *d)
{
    struct bench b;
    pvx_err e = bench_new(job, p, &b, d);
    PVX_THEN(e, bench_run(job, p, flame, &b, sets, ms, d));
    bench_free(&b);
    return e;
}

static void compute_compare(struct dmn_compute *c, const struct dmn_compute_job *job,
                            const struct rec_frame_params *p, const dmn_compute_flame *flame)
{
    struct rec_frame_params on = *p;
    struct pvx_diag why = {""};
    const char *name = rec_cl_about(c->card)->name;
    double here = 0, there = 0;
    size_t sets = 0;
    on.card = NULL;
    pvx_err e = compute_measure(job, &on, flame, &sets, &here, &why);
    on.card = c->card;
    PVX_THEN(e, compute_measure(job, &on, flame, &sets, &there, &why));
    if (e == PVX_OK && there < here) {
        c->measure = false;
        snprintf(c->said, sizeof c->said, "compute: %s, %.1f ms a set against %.1f ms here", name,
                 there, here);
    } else if (e == PVX_OK) {
        snprintf(c->said, sizeof c->said,
                 "compute: the processors, %.1f ms a set against %.1f ms on %s", here, there, name);
    } else {
        snprintf(c->said, sizeof c->said, "compute: the processors, because of %s: %.500s", name,
                 compute_reason(c->card, pvx_diag_text(&why, e)));
    }
}

pvx_err dmn_compute_choose(struct dmn_compute *c, const struct dmn_compute_job *job,
                           struct rec_frame_params *p, struct pvx_diag *d)
{
    dmn_compute_flame *flame = NULL;
    p->card = NULL;
    if (c->card == NULL)
        return PVX_OK;
    if (c->measure) {
        if (job->load == NULL && dmn_compute_flame_new(job->S, p, job->pool, &flame) != PVX_OK)
            return pvx_fail(d, PVX_ENOMEM, "out of memory for a flame to measure with");
        compute_compare(c, job, p, flame);
        dmn_compute_flame_free(&flame);
        if (c->measure)
            dmn_compute_close(c);
    } else {
        snprintf(c->said, sizeof c->said, "compute: %s, driver %s", rec_cl_about(c->card)->name,
                 rec_cl_about(c->card)->driver);
    }
    p->card = c->card;
    return PVX_OK;
}
