#include "recon/frame/bars.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/frame/impl.h"
#include "recon/frame/parts.h"

#define GAP   15.0 /* (3) */
#define DRAWN 0.6  /* factor on (4) */
#define PRIOR 0.25 /* share of the prior in it; from a weight of */
#define SHARP 0.02 /* times the mean diagonal on they rise, and */
#define DULL  0.5  /* from this one on both are 1 */
#define BLUR  0.25 /* doubt: the weight of the best channel over the mean diagonal */
#define HUE   2.0  /* (5) */
#define LEAST 6    /* iterations, at least */
#define VIEWS 80   /* J: iterations times cameras, at least: of few cameras each one matters more */
#define POOR  25.0 /* doubt: sigma^2 over that of the dark */

struct rec_bars {
    uint32_t K;
    size_t cs, voxels, bytes;
    void *areas;
    float *modes, *sd; /* [K + 1][n][cs], [n][cs] */
    float *mean;       /* [n][cs] */
    struct rec_spread spread;
    rec_perturb *perturb;

    /* of the frame at hand */
    rec_frame *f;
    size_t vector; /* n cs */
    struct rec_perturb_fit fit[4];
    struct rec_perturbation p;
    struct rec_bars_view *out;
};

static size_t bars_lay_out(struct rec_bars *b, float *base)
{
    const size_t vector = b->voxels * b->cs;
    struct {
        float **to;
        size_t floats;
    } const parts[] = {{&b->modes, (b->K + 1) * vector},
                       {&b->sd, vector},
                       {&b->mean, vector},
                       {&b->spread.work[0], vector},
                       {&b->spread.work[1], vector},
                       {&b->spread.inverse, b->voxels}};
    size_t at = 0;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        if (base != NULL)
            *parts[i].to = base + at;
        at += (parts[i].floats + 15) / 16 * 16;
    }
    b->spread.place = base != NULL ? (int32_t *)(base + at) : NULL;
    return (at + b->voxels) * sizeof *base;
}

pvx_err rec_bars_new(const rec_sysmat *S, int nch, uint32_t K, rec_bars **out, struct pvx_diag *d)
{
    *out = NULL;
    if (K < REC_BARS_LEAST || K > REC_BARS_MOST)
        return pvx_fail(d, PVX_EINVAL, "error bars of %u solves, want %d to %d", K, REC_BARS_LEAST,
                        REC_BARS_MOST);
    rec_bars *b = *out = pvx_calloc(1, sizeof *b);
    if (b == NULL)
        return pvx_fail(d, PVX_ENOMEM, "error bars: out of memory");
    b->K = K;
    b->cs = nch == 3 ? 4 : 1;
    b->voxels = rec_grid_count(&S->grid);
    b->bytes = bars_lay_out(b, NULL);
    b->areas = pvx_reserve(b->bytes);
    pvx_err e = b->areas != NULL ? rec_perturb_new(S, nch, &b->perturb) : PVX_ENOMEM;
    if (e != PVX_OK) {
        rec_bars_free(out);
        return pvx_fail(d, e, "error bars: work areas for %zu voxels: %s", rec_grid_count(&S->grid),
                        pvx_strerror(e));
    }
    bars_lay_out(b, b->areas);
    return PVX_OK;
}

void rec_bars_free(rec_bars **b)
{
    if (*b == NULL)
        return;
    pvx_unreserve((*b)->areas, (*b)->bytes);
    rec_perturb_free(&(*b)->perturb);
    PVX_FREE(*b);
}

/* ---- the solves ---------------------------------------------------------------------------------*/

static float *bars_mode(const rec_bars *b, uint32_t k)
{
    return b->modes + k * b->vector;
}

/* One more solve, with b->p, into the next mode. */
static float *bars_solve(rec_bars *b)
{
    float *x = bars_mode(b, b->out->n_modes++);
    b->out->iterations += rec_perturb_solve(b->perturb, &b->p, x);
    b->out->solves++;
    return x;
}

double rec_bars_student(double n)
{
    return sqrt(1 + 2 / fmax(n - 2, 2));
}

uint32_t rec_bars_iterations(uint32_t done, uint32_t cameras)
{
    uint32_t least = cameras > 0 ? VIEWS / cameras : 0, all = done > LEAST ? done : LEAST;
    return all > least ? all : least;
}

/* The next solve is the frame's own, with nothing moved; cameras: of J, else 0. */
static void bars_still(rec_bars *b, uint32_t cameras)
{
    b->p = (struct rec_perturbation){.seed = b->p.seed};
    b->p.iterations = rec_bars_iterations(b->f->report.solve.iterations, cameras);
}

double rec_bars_groups(uint32_t cameras, uint32_t left)
{
    return (1 - 1.0 / left) * fmax(1, (GAP - cameras) / (cameras - 1.0));
}

/* J: the cameras in `left` groups. */
static void bars_leave(rec_bars *b, uint32_t cameras, uint32_t left)
{
    const rec_frame *f = b->f;
    uint32_t first = b->out->n_modes;
    bool out[REC_MAX_CAMERAS] = {false};
    memset(b->mean, 0, b->vector * sizeof *b->mean);
    bars_still(b, cameras);
    b->p.out = out;
    for (uint32_t g = 0; g < left; g++) {
        for (size_t c = 0, k = 0; c < f->S->n_cameras; c++)
            out[c] = f->sub->present[c] && k++ % left == g;
        const float *x = bars_solve(b);
        for (size_t i = 0; i < b->vector; i++)
            b->mean[i] += x[i];
    }
    float by = (float)(sqrt(rec_bars_groups(cameras, left)) * rec_bars_student(left - 1)),
          each = 1 / (float)left;
    for (uint32_t k = first; k < b->out->n_modes; k++) {
        float *d = bars_mode(b, k);
        for (size_t i = 0; i < b->vector; i++)
            d[i] = by * (d[i] - each * b->mean[i]);
    }
}

/* d = by (x_k - x) for the mode that was solved last. */
static void bars_about(rec_bars *b, float *d, const double by[4])
{
    for (size_t i = 0; i < b->vector; i++)
        d[i] = (float)by[i % b->cs] * (d[i] - b->f->x[i]);
}

/* From 0 to 1: how far the smoothness term hides what a channel's noise would hide. */
static double bars_dull(const struct rec_perturb_fit *fit)
{
    double at = fit->unit > 0 ? log(fit->lambda / fit->unit / SHARP) / log(DULL / SHARP) : 1;
    return at >= 1 ? 1 : at > 0 ? at : 0;
}

void rec_bars_drawn(const struct rec_perturb_fit fit[4], int nch, bool alone,
                    struct rec_perturbation *p, double by[4])
{
    for (int l = 0; l < nch; l++) {
        double dull = alone ? 1 : bars_dull(&fit[l]);
        p->sigma[l] = sqrt(fit[l].noise2);
        p->prior[l] = PRIOR + (1 - PRIOR) * dull;
        by[l] = DRAWN + (1 - DRAWN) * dull;
    }
}

/* D; alone: without J. */
static void bars_draw(rec_bars *b, uint32_t drawn, bool alone)
{
    double by[4] = {0};
    bars_still(b, 0);
    rec_bars_drawn(b->fit, b->f->nch, alone, &b->p, by);
    for (int l = 0; l < b->f->nch; l++)
        by[l] *= rec_bars_student(drawn) / sqrt(drawn);
    for (b->p.draw = 0; b->p.draw < drawn; b->p.draw++)
        bars_about(b, bars_solve(b), by);
}

void rec_bars_hue(struct rec_spread *s, const struct rec_perturb_fit fit[4], const float *x,
                  float *mean, float *d)
{
    float by[4] = {0};
    size_t best = 0, cs = 4;
    for (size_t l = 1; l < 3; l++)
        best = fit[l].g > fit[best].g ? l : best;
    for (size_t l = 0; l < 3; l++)
        by[l] = (float)(HUE * sqrt(fmax(0, 1 - fit[l].g / fit[best].g)));
    rec_spread_mean(s, x, d);
    rec_spread_mean(s, d, mean);
    for (size_t i = 0; i < (size_t)s->a->n * cs; i += cs)
        for (size_t l = 0; l < cs; l++) {
            float usual = mean[i + best];
            float other = usual > 0 ? x[i + best] / usual * mean[i + l] : 0;
            d[i + l] = by[l] > 0 ? by[l] * (other - x[i + l]) : 0;
        }
}

/* ---- all of it ----------------------------------------------------------------------------------*/

uint32_t rec_bars_doubt(const struct rec_perturb_fit fit[4], int nch, uint32_t cameras)
{
    uint32_t doubt = cameras < REC_BARS_CAMERAS ? REC_BARS_FEW_CAMERAS : 0;
    double least = INFINITY;
    for (int l = 0; l < nch; l++) {
        if (fit[l].dark2 > 0 && fit[l].noise2 > POOR * fit[l].dark2)
            doubt |= REC_BARS_POOR_FIT;
        least = fit[l].unit > 0 ? fmin(least, fit[l].lambda / fit[l].unit) : least;
    }
    return least > BLUR ? doubt | REC_BARS_BLURRED : doubt;
}

pvx_err rec_frame_bars(rec_frame *f, rec_bars *b, uint64_t seed, struct rec_bars_view *out)
{
    uint32_t cameras = 0;
    *out = (struct rec_bars_view){.nch = f->nch, .cs = f->cs, .n = f->sub->n, .index = f->col};
    if (!rec_solver_is_default(f->solver->p.solver))
        return PVX_EUNSUP;
    if (!rec_perturb_begin(b->perturb, f->solver->problem, f->x, b->fit))
        return PVX_OK;
    b->f = f;
    b->out = out;
    b->vector = (size_t)f->sub->n * b->cs;
    b->p.seed = seed;
    for (size_t c = 0; c < f->S->n_cameras; c++)
        cameras += f->sub->present[c];
    bool few = cameras < REC_BARS_LEAVES;
    uint32_t left = few ? 0 : b->K / 2;
    left = left < cameras ? left : cameras;
    rec_spread_begin(&b->spread, f->sub);
    if (left > 0)
        bars_leave(b, cameras, left);
    bars_draw(b, b->K - left, few);
    rec_perturb_end(b->perturb);
    if (f->nch == 3)
        rec_bars_hue(&b->spread, b->fit, f->x, b->mean, bars_mode(b, out->n_modes++));
    rec_spread_deviations(&b->spread, b->modes, out->n_modes, b->sd);
    rec_spread_end(&b->spread);
    out->sd = b->sd;
    out->modes = b->modes;
    out->doubt = rec_bars_doubt(b->fit, f->nch, cameras);
    return PVX_OK;
}
