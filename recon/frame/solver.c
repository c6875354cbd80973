/* solver.c - the second stage: problem, start, method. */
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "recon/frame/card.h"
#include "recon/solve/start.h"

bool rec_frame_corrects(const struct rec_frame_params *p)
{
    return p->selfcal != REC_SELFCAL_OFF && p->coarse_start &&
           rec_solver_is_default(p->solve.solver);
}

pvx_err rec_solver_new(const rec_sysmat *S, const struct rec_frame_params *p, rec_solver **out,
                       struct pvx_diag *d)
{
    rec_solver *s = *out = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return pvx_fail(d, PVX_ENOMEM, "solver: out of memory");
    s->p = p->solve;
    s->coarse = p->coarse_start && rec_solver_is_default(p->solve.solver) && S->coarse != NULL;
    pvx_err e = rec_problem_new(S, p->nch, &s->problem);
    if (e == PVX_OK && s->coarse)
        e = rec_descent_init(&s->descent, S, p->nch);
    s->mode = p->selfcal;
    if (e == PVX_OK && s->coarse && rec_frame_corrects(p))
        e = rec_selfcal_new(S, &s->selfcal);
    if (e == PVX_OK)
        rec_selfcal_attach(s->problem, s->selfcal);
    if (e == PVX_OK && s->coarse && p->temporal)
        e = rec_temporal_new(&S->grid, p->nch == 3 ? 4 : 1, &s->temporal);
    if (e != PVX_OK) {
        rec_solver_free(out);
        return pvx_fail(d, e, "solver: work areas for %zu voxels and %d channels: %s",
                        rec_grid_count(&S->grid), p->nch, pvx_strerror(e));
    }
    return PVX_OK;
}

void rec_solver_free(rec_solver **s)
{
    if (*s == NULL)
        return;
    rec_card_solver_fini(*s);
    rec_problem_free(&(*s)->problem);
    rec_descent_fini(&(*s)->descent);
    rec_selfcal_free(&(*s)->selfcal);
    rec_temporal_free(&(*s)->temporal);
    PVX_FREE(*s);
}

void rec_solver_tune(rec_solver *s, const struct rec_solve_params *p)
{
    const char *method = s->p.solver;
    s->p = *p;
    s->p.solver = method;
}

/* x = the earlier volume on this frame's voxels, 0 where it had none; both lists ascend. */
static void earlier_volume(rec_frame *f, const struct rec_sparse *from)
{
    int32_t at = 0;
    size_t cs = (size_t)f->cs;
    for (int32_t q = 0; q < f->sub->n; q++) {
        while (at < from->n && from->index[at] < f->col[q])
            at++;
        float *x = f->x + (size_t)q * cs;
        memset(x, 0, cs * sizeof *x);
        if (at < from->n && from->index[at] == f->col[q])
            memcpy(x, from->value + (size_t)at * cs, (size_t)f->nch * sizeof *x);
    }
}

/* Writes the start to x: with coarser grids their solution or the earlier volume, whichever fits better. */
static void solver_start(rec_frame *f, const struct rec_solve_params *p, bool any, bool warm,
                         float *x)
{
    rec_solver *s = f->solver;
    struct rec_descent *d = &s->descent;
    f->report.warm = warm;
    if (s->coarse && any) {
        d->levels = f->levels;
        d->deadline_ns = p->deadline_ns;
        rec_problem_weigh(s->problem, p->lambda);
        f->report.warm = rec_levels_start(s->problem, d, x, warm ? d->spare : NULL);
        f->report.coarse_iterations = d->iterations;
    } else if (warm) {
        rec_start_earlier(s->problem, x);
    } else {
        rec_start_zero(s->problem, x);
    }
}

void rec_solver_average(rec_solver *s, rec_average *a)
{
    s->average = a;
}

/* The corrections that the next set starts from. */
static void solver_correct(rec_solver *s)
{
    struct rec_selfcal_given given;
    enum rec_selfcal_how how = REC_SELFCAL_ALONE;
    if (s->selfcal == NULL)
        return;
    if (s->average != NULL)
        how = rec_average_given(s->average, &given);
    rec_selfcal_begin(s->selfcal, s->mode, how, s->average != NULL ? &given : NULL);
}

/* What the set, or the average with it, knows of the cameras.  A solve that its deadline ended early leaves more than
 * the cameras do, and is not averaged. */
static void solver_tell(rec_solver *s, const struct rec_solve_report *r,
                        struct rec_selfcal_report *out)
{
    struct rec_selfcal_look look[REC_MAX_CAMERAS];
    if (s->selfcal == NULL)
        return;
    rec_selfcal_tell(s->selfcal, out);
    if (s->average == NULL)
        return;
    rec_selfcal_look(s->selfcal, look);
    if (r->status != REC_DEADLINE || r->renewals > 0)
        rec_average_add(s->average, look);
    struct rec_selfcal_report of_all;
    rec_average_tell(s->average, &of_all);
    if (of_all.sets > 0)
        *out = of_all;
}

/* Problem, start and method.  x: [n][cs], the earlier volume where the solve starts from one. */
static pvx_err solver_run(rec_frame *f, const struct rec_solve_params *p,
                          const struct rec_sparse *previous, float *x)
{
    rec_solver *s = f->solver;
    struct rec_pictures in = rec_frame_pictures(f);
    bool expect = previous != NULL && s->temporal != NULL;
    solver_correct(s);
    bool any = rec_problem_load(s->problem, f->sub, &in);
    solver_start(f, p, any, previous != NULL && !expect, x);
    f->report.temporal = 0;
    if (expect && any && (p->deadline_ns == 0 || pvx_now_mono() < p->deadline_ns)) {
        const struct rec_flow_volume v = {previous->n, previous->index, previous->value, f->cs,
                                          f->nch};
        f->report.temporal = rec_temporal_expect(s->temporal, s->problem, &v, x);
    }
    return rec_solve(s->problem, p, x, &f->report.solve);
}

/* On the card.  false: the set is solved here, as if nothing had been done. */
static bool solver_run_there(rec_frame *f, const struct rec_solve_params *p,
                             const struct rec_sparse *previous)
{
    float *x = rec_card_begin(f, p, previous);
    return x != NULL && rec_card_end(f, solver_run(f, p, previous, x));
}

pvx_err rec_frame_solve(rec_frame *f, int64_t deadline_ns, const struct rec_sparse *previous)
{
    int64_t t0 = pvx_now_mono();
    struct rec_solve_params p = f->solver->p;
    pvx_err e = PVX_OK;
    if (deadline_ns != 0)
        p.deadline_ns = deadline_ns;
    if (previous != NULL && previous->n == 0)
        previous = NULL;
    if (previous != NULL && (previous->cs != f->cs || previous->value == f->x))
        return PVX_EINVAL;
    bool there = f->sub->card != NULL && solver_run_there(f, &p, previous);
    if (!there) {
        if (f->sub->card != NULL) {
            rec_card_leave(f);
            p.deadline_ns += p.deadline_ns != 0 ? pvx_now_mono() - t0 : 0; /* as much time again */
        }
        if (previous != NULL && f->solver->temporal == NULL)
            earlier_volume(f, previous);
        e = solver_run(f, &p, previous, f->x);
    }
    solver_tell(f->solver, &f->report.solve, &f->report.selfcal);
    f->report.solve_ns = pvx_now_mono() - t0;
    return e;
}
