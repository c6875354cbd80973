#include "recon/frame/card.h"

#include <stdio.h>

#include "base/clock.h"
#include "recon/opencl/solver.h"

#define SETS  5      /* on the card at a time, about */
#define LEAST 100000 /* room for columns below which nothing is halved */

const char *rec_frame_card_why_not(const struct rec_frame_params *p)
{
    if (!rec_solver_is_default(p->solve.solver))
        return "a solver for comparison";
    if (p->solve.stop == REC_STOP_LCURVE)
        return "the stop at the corner of the L-curve";
    if (p->temporal)
        return "the expectation from the previous volume";
    if (p->at_least)
        return "saturated pixels as lower bounds";
    if (p->again)
        return "error bars";
    if (p->solve.trace != NULL)
        return "a trace of the iterates";
    return NULL;
}

/* ---- what is made once --------------------------------------------------------------------------*/

/* Room for columns: of all voxels, or of a half, a quarter of them if all sets and vectors would take more than half of
 * the device's memory.  With the coarser grids everything over voxels takes 8/7, over rows 4/3. */
static size_t card_columns(const rec_sysmat *S, int cs, uint64_t memory)
{
    double lane = 4.0 * cs, voxels = (double)rec_grid_count(&S->grid), rows = (double)S->win.room;
    double set = 8.0 / 7 * voxels * (5 + lane) + 4.0 / 3 * rows * (lane + 21);
    double vectors = 4.0 / 3 * rows * (5 * lane + 20);
    double column = 8.0 / 7 * (SETS * 28 + 13 * lane + 20);
    size_t n = rec_grid_count(&S->grid);
    while (n > LEAST && SETS * set + vectors + column * (double)n > 0.5 * (double)memory)
        n /= 2;
    return n;
}

pvx_err rec_card_carver(rec_carver *k, struct pvx_diag *d)
{
    struct rec_cl *cl = k->p.card;
    if (cl == NULL || rec_frame_card_why_not(&k->p) != NULL)
        return PVX_OK;
    k->columns = card_columns(k->S, k->p.nch == 3 ? 4 : 1, rec_cl_about(cl)->memory);
    return rec_cl_matrix_new(cl, k->S, &k->matrix, d);
}

pvx_err rec_card_solver(rec_solver *s, const rec_carver *k, struct pvx_diag *d)
{
    if (k->matrix == NULL || s->card != NULL)
        return PVX_OK;
    PVX_TRY(rec_restrictor_new(k->S, &s->restrictor));
    s->matrix = rec_cl_matrix_share(k->matrix);
    return rec_cl_solver_new(k->matrix, k->p.nch == 3 ? 4 : 1, k->columns, s->problem,
                             s->coarse ? &s->descent : NULL, &s->card, d);
}

pvx_err rec_card_systems(rec_systems *y, const rec_carver *k, struct pvx_diag *d)
{
    if (k->matrix == NULL)
        return PVX_OK;
    y->matrix = rec_cl_matrix_share(k->matrix);
    return rec_cl_system_new(k->matrix, k->p.nch == 3 ? 4 : 1, k->columns, &y->card, d);
}

void rec_card_carver_fini(rec_carver *k)
{
    if (k->matrix != NULL)
        rec_cl_matrix_free(&k->matrix);
}

void rec_card_solver_fini(rec_solver *s)
{
    if (s->card != NULL)
        rec_cl_solver_free(&s->card);
    if (s->matrix != NULL)
        rec_cl_matrix_free(&s->matrix);
    rec_restrictor_free(&s->restrictor);
}

void rec_card_systems_fini(rec_systems *y)
{
    if (y->card != NULL)
        rec_cl_system_free(&y->card);
    if (y->matrix != NULL)
        rec_cl_matrix_free(&y->matrix);
}

/* ---- a frame set --------------------------------------------------------------------------------*/

/* Reports why the set is solved here. */
static void card_say(rec_frame *f, const char *why)
{
    struct rec_frame_report *r = &f->report;
    snprintf(r->why_here, sizeof r->why_here, "%s", why != NULL ? why : "its carver has no card");
}

bool rec_card_carve(rec_frame *f, const uint8_t *const *lit, struct rec_hull_kept *kept)
{
    rec_carver *k = f->carver;
    struct rec_frame_report *r = &f->report;
    struct rec_pictures in = rec_frame_pictures(f);
    const struct rec_cl_carving c = {&k->p.hull, lit, f->believed, &in, f->weight};
    bool too_many = false;
    if (k->p.card == NULL)
        return false;
    if (f->systems->card == NULL || f->solver->card == NULL) {
        card_say(f, rec_frame_card_why_not(&k->p));
        return false;
    }
    int64_t t0 = pvx_now_mono();
    bool done = rec_cl_carve(f->systems->card, &c, kept, f->sub, &too_many);
    int64_t t1 = pvx_now_mono();
    if (done && f->levels != NULL)
        rec_levels_restrict(f->levels, k->restrictor, f->sub, &in);
    r->hull_ns = t1 - t0;
    r->restrict_ns = pvx_now_mono() - t1;
    if (too_many)
        snprintf(r->why_here, sizeof r->why_here,
                 "more active voxels than the card has room for (%zu)", k->columns);
    else if (rec_cl_lost(k->p.card) != NULL)
        card_say(f, rec_cl_lost(k->p.card));
    return done && r->why_here[0] == '\0';
}

float *rec_card_begin(rec_frame *f, const struct rec_solve_params *p,
                      const struct rec_sparse *previous)
{
    struct rec_cl_solver *s = f->solver->card;
    const struct rec_frame_params now = {.solve = *p}; /* as rec_solver_tune has them */
    const char *why_not = rec_frame_card_why_not(&now);
    if (why_not != NULL) {
        card_say(f, why_not);
        return NULL;
    }
    rec_cl_solver_begin(s, f->systems->card);
    if (previous != NULL)
        rec_cl_solver_earlier(s, previous->n, previous->index, previous->value);
    return rec_cl_solver_x(s);
}

bool rec_card_end(rec_frame *f, pvx_err e)
{
    f->report.on_card = rec_cl_solver_end(f->solver->card, f->x) && e == PVX_OK;
    if (!f->report.on_card) {
        const char *lost = rec_cl_lost(f->carver->p.card);
        card_say(f, lost != NULL ? lost : pvx_strerror(e));
    }
    return f->report.on_card;
}

void rec_card_leave(rec_frame *f)
{
    struct rec_pictures in = rec_frame_pictures(f);
    struct rec_restrictor *r = f->solver->restrictor;
    rec_subsys_restrict(f->sub, r, f->col, (int32_t)f->report.active_voxels, f->believed);
    if (f->levels != NULL)
        rec_levels_restrict(f->levels, r, f->sub, &in);
}
