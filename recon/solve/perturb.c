#include "recon/solve/perturb.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "base/random.h"
#include "recon/solve/impl.h"

struct rec_perturb {
    size_t rows, voxels, cs; /* of S: room of a vector over rows, voxels */
    void *areas;
    size_t bytes;
    float *b, *w, *w4;    /* [room][cs], [room], [room][4]: the problem's own */
    float *expect, *lhat; /* [n][cs] xhat and a L xhat of (1b) in pcg.c, moved */
    const float *x;       /* the solution */
    rec_problem *pb;
    struct rec_selfcal *selfcal;
    double lambda[4]; /* of the solution */
    struct rec_frozen frozen;
    const struct rec_perturbation *p;
};

static size_t perturb_lay_out(rec_perturb *t, float *base)
{
    const size_t rows = t->rows * t->cs, voxels = t->voxels * t->cs;
    const size_t sizes[] = {rows, t->rows, t->rows * 4, voxels, voxels};
    float **const to[] = {&t->b, &t->w, &t->w4, &t->expect, &t->lhat};
    size_t at = 0;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        if (base != NULL)
            *to[i] = base + at;
        at += (sizes[i] + 15) / 16 * 16;
    }
    return at * sizeof *base;
}

pvx_err rec_perturb_new(const rec_sysmat *S, int nch, rec_perturb **out)
{
    rec_perturb *t = *out = pvx_calloc(1, sizeof *t);
    if (t == NULL)
        return PVX_ENOMEM;
    t->rows = S->win.room;
    t->voxels = rec_grid_count(&S->grid);
    t->cs = nch == 3 ? 4 : 1;
    t->bytes = perturb_lay_out(t, NULL);
    t->areas = pvx_reserve(t->bytes);
    if (t->areas == NULL) {
        rec_perturb_free(out);
        return PVX_ENOMEM;
    }
    perturb_lay_out(t, t->areas);
    return PVX_OK;
}

void rec_perturb_free(rec_perturb **t)
{
    if (*t == NULL)
        return;
    pvx_unreserve((*t)->areas, (*t)->bytes);
    PVX_FREE(*t);
}

/* ---- what was solved ----------------------------------------------------------------------------*/

static size_t solved_lit(const rec_problem *pb, const float *x, size_t l)
{
    size_t lit = 0, cs = (size_t)pb->cs;
    for (size_t q = 0; q < (size_t)pb->a->n; q++)
        lit += x[q * cs + l] > 0;
    return lit;
}

static void perturb_keep_rows(void *ctx, size_t k)
{
    rec_perturb *t = ctx;
    const rec_problem *pb = t->pb;
    REC_FOR_ROWS (i, pb->a, k) {
        t->w[i] = pb->w[i];
        if (pb->in.per_channel)
            memcpy(t->w4 + i * 4, pb->w4 + i * 4, 4 * sizeof *t->w4);
        for (size_t l = 0; l < t->cs; l++) {
            size_t at = i * t->cs + l;
            t->b[at] = pb->a->is_row[i] ? pb->b[at] : 0;
        }
    }
}

/* `excess` of every lane, from W r. */
static void perturb_excess(const rec_problem *pb, const float *wr, struct rec_perturb_fit fit[4])
{
    double more[4] = {0}, all[4] = {0};
    size_t cs = (size_t)pb->cs;
    for (size_t k = 0; k < rec_row_chunks(pb); k++)
        REC_FOR_ROWS (i, pb->a, k)
            for (size_t l = 0; l < cs && pb->a->is_row[i]; l++) {
                float w = pb->in.per_channel ? pb->w4[i * 4 + l] : pb->w[i];
                more[l] += (double)wr[i * cs + l];
                all[l] += (double)(w * pb->b[i * cs + l]);
            }
    for (int l = 0; l < pb->nch; l++)
        fit[l].excess = all[l] > 0 ? more[l] / all[l] : 0;
}

bool rec_perturb_begin(rec_perturb *t, rec_problem *pb, const float *x,
                       struct rec_perturb_fit fit[4])
{
    double rwr[4];
    memset(fit, 0, 4 * sizeof *fit);
    if (!pb->any)
        return false;
    t->pb = pb;
    t->x = x;
    rec_residual(pb, x, pb->yv[0], pb->yv[1], rwr);
    pvx_pool_run(pb->a->pool, rec_row_chunks(pb), perturb_keep_rows, t);
    perturb_excess(pb, pb->yv[1], fit);
    bool any = false;
    memcpy(t->lambda, pb->ended.lambda, sizeof t->lambda);
    for (int l = 0; l < pb->nch; l++) {
        struct rec_perturb_fit *f = &fit[l];
        double sigma = pb->in.sigma[l];
        f->m = rec_rows_of(pb, l);
        f->lambda = pb->ended.lambda[l];
        f->unit = pb->unit[l];
        f->g = rec_problem_freedom(pb, l, (double)solved_lit(pb, x, (size_t)l), f->lambda);
        f->noise2 = f->m > f->g ? rwr[l] / (f->m - f->g) : 0;
        f->dark2 = sigma >= 0 ? sigma * sigma + pb->shot2[l] : -1;
        any = any || (f->lambda > 0 && f->noise2 > 0);
    }
    return any;
}

/* ---- what chance moves --------------------------------------------------------------------------*/

enum { OF_ROWS, OF_VOXELS, OF_PREDICTION, N_OF };

/* The signs of an entry in its four lanes, as bits: from a number of its own for every 16 draws. */
static inline uint32_t perturb_signs(const struct rec_perturbation *p, size_t entry, int of)
{
    uint64_t key = p->seed * 0x9E3779B97F4A7C15u + p->draw / 16;
    uint64_t word = pvx_mix(pvx_mix(key) + N_OF * (uint64_t)entry + (uint64_t)of);
    return (uint32_t)(word >> 4 * (p->draw % 16)) & 15;
}
static inline double perturb_sign(uint32_t signs, size_t l)
{
    return signs >> l & 1 ? 1 : -1;
}

static void perturb_row(const rec_perturb *t, size_t c, size_t i)
{
    rec_problem *pb = t->pb;
    const struct rec_perturbation *p = t->p;
    bool out = p->out != NULL && p->out[c];
    uint32_t signs = perturb_signs(p, i, OF_ROWS);
    pb->w[i] = out ? 0 : t->w[i];
    for (size_t l = 0; l < 4 && pb->in.per_channel; l++)
        pb->w4[i * 4 + l] = out ? 0 : t->w4[i * 4 + l];
    for (size_t l = 0; l < t->cs; l++) {
        size_t at = i * t->cs + l;
        double w = rec_weight_at(pb, i, l), b = t->b[at];
        if (pb->in.least != NULL && pb->in.least[i] > 0 && (pb->in.least_of[i] >> l & 1) != 0) {
            b = pb->given[at]; /* a bound */
        } else if (w > 0) {
            b += p->sigma[l] * perturb_sign(signs, l) / sqrt(w);
        }
        pb->b[at] = (float)b;
    }
}
static void perturb_rows(void *ctx, size_t k)
{
    const rec_perturb *t = ctx;
    size_t c = 0;
    REC_FOR_ROWS (i, t->pb->a, k) {
        while (i >= t->pb->a->row0[c + 1])
            c++;
        if (t->pb->a->is_row[i])
            perturb_row(t, c, i);
    }
}

/* Standard deviation of an entry of the prior whose weight is lambda `by`. */
static double perturb_prior(const rec_perturb *t, size_t l, double by)
{
    double weight = t->frozen.lambda[l] * by;
    return weight > 0 ? t->p->prior[l] * t->p->sigma[l] / sqrt(weight) : 0;
}

/* lhat = a L xhat + sigma (lambda V)^(-1/2) e2,  expect = xhat + sigma (lambda nu)^(-1/2) e3. */
static void perturb_columns(void *ctx, size_t k)
{
    const rec_perturb *t = ctx;
    const rec_problem *pb = t->pb;
    int32_t q0, q1;
    rec_chunk_range(pb->a->n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        size_t voxel = (size_t)pb->a->col[q], at = (size_t)q * t->cs;
        uint32_t e2 = perturb_signs(t->p, voxel, OF_VOXELS);
        uint32_t e3 = perturb_signs(t->p, voxel, OF_PREDICTION);
        double v = pb->stiff.by[q];
        for (size_t l = 0; l < t->cs; l++, at++) {
            t->lhat[at] = (float)(perturb_prior(t, l, v) * perturb_sign(e2, l));
            t->expect[at] = 0;
            if (pb->expect == NULL)
                continue;
            t->lhat[at] += pb->xv[REC_XV_LHAT][at];
            t->expect[at] =
                pb->expect[at] + (float)(perturb_prior(t, l, pb->nu[l]) * perturb_sign(e3, l));
        }
    }
}

uint32_t rec_perturb_solve(rec_perturb *t, const struct rec_perturbation *p, float *x)
{
    rec_problem *pb = t->pb;
    struct rec_selfcal *selfcal = pb->selfcal;
    struct rec_solve_report report;
    struct rec_solve_params params = rec_solve_defaults;
    params.stop = REC_STOP_ITERATIONS;
    params.iterations = p->iterations;
    params.deadline_ns = p->deadline_ns;
    t->p = p;
    t->frozen = (struct rec_frozen){.expect = t->expect, .lhat = t->lhat};
    memcpy(t->frozen.lambda, t->lambda, sizeof t->frozen.lambda);
    if (pb->expect != NULL)
        memcpy(t->frozen.nu, pb->nu, sizeof t->frozen.nu);
    pvx_pool_run(pb->a->pool, rec_row_chunks(pb), perturb_rows, t);
    pvx_pool_run(pb->a->pool, rec_column_chunks(pb), perturb_columns, t);
    rec_copy_x(pb, x, t->x);
    pb->frozen = &t->frozen;
    pb->selfcal = NULL; /* cameras stay as they were corrected */
    pb->renewals = 0;
    pb->start = REC_START_FITS;
    if (rec_solve(pb, &params, x, &report) != PVX_OK) /* the default method exists */
        rec_copy_x(pb, x, t->x);
    pb->selfcal = selfcal;
    pb->frozen = NULL;
    return report.iterations;
}

static void perturb_restore_rows(void *ctx, size_t k)
{
    const rec_perturb *t = ctx;
    rec_problem *pb = t->pb;
    REC_FOR_ROWS (i, pb->a, k) {
        pb->w[i] = t->w[i];
        memcpy(pb->b + i * t->cs, t->b + i * t->cs, t->cs * sizeof *t->b);
        if (pb->in.per_channel)
            memcpy(pb->w4 + i * 4, t->w4 + i * 4, 4 * sizeof *t->w4);
    }
}

void rec_perturb_end(rec_perturb *t)
{
    pvx_pool_run(t->pb->a->pool, rec_row_chunks(t->pb), perturb_restore_rows, t);
    memcpy(t->pb->ended.lambda, t->lambda, sizeof t->lambda);
    t->pb = NULL;
}
