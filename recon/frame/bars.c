#include "recon/frame/bars.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "base/random.h"
#include "recon/frame/impl.h"
#include "recon/frame/parts.h"

#define JACK    1.15 /* (3) */
#define GAP     10.0
#define DRAWN   0.4 /* factor on (4) of a sharp flame */
#define DRAWS   4   /* of D, beside J: more of them tell little */
#define PRIOR   0.6 /* share of the prior in it, from a weight of 0.5 times the mean diagonal to 8 */
#define DULL    0.5
#define DULLEST 8.0
#define LOST    3.0 /* (5) */
#define UNSEEN  0.8
#define MOST    6.0
#define ROUGH   0.09
#define BLOCK   8  /* voxels along a side, over which (5) has one sign */
#define LEAST   6  /* iterations, at least */
#define VIEWS   80 /* J: iterations times cameras, at least: of few cameras each one matters more */
#define POOR    25.0 /* doubt: sigma^2 over that of the dark */
#define FINE    0.4  /* doubt: R of (5) */
#define BLUR    0.5  /* doubt: f_r of (5) by the weight alone */

struct rec_bars {
    uint32_t K;
    size_t cs, voxels, bytes;
    void *areas;
    float *modes, *sd; /* [K + 3][n][cs], [n][cs] */
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
    } const parts[] = {{&b->modes, (b->K + 3) * vector},
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

uint32_t rec_bars_iterations(const struct rec_solve_report *r, uint32_t cameras)
{
    uint32_t done = r->iterations - r->blended / 2;
    uint32_t least = cameras > 0 ? VIEWS / cameras : 0, all = done > LEAST ? done : LEAST;
    return all > least ? all : least;
}

/* The next solve is the frame's own, with nothing moved; cameras: of J, else 0. */
static void bars_still(rec_bars *b, uint32_t cameras)
{
    b->p = (struct rec_perturbation){.seed = b->p.seed};
    b->p.iterations = rec_bars_iterations(&b->f->report.solve, cameras);
}

/* Second factor of (3). */
static double bars_gaps(uint32_t cameras)
{
    double gap = cameras > 1 ? fmax(1, (GAP - cameras) / (cameras - 1.0)) : 1;
    return gap * gap;
}
double rec_bars_groups(const struct rec_solve_report *r, uint32_t cameras, uint32_t left)
{
    double spared = fmax(1, (double)r->iterations / rec_bars_iterations(r, cameras));
    return JACK * JACK * (1 - 1.0 / left) * bars_gaps(cameras) * spared;
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
    float by = (float)(sqrt(rec_bars_groups(&b->f->report.solve, cameras, left)) *
                       rec_bars_student(left - 1)),
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

/* The last factor of (5), from R. */
static double bars_rough(double detail)
{
    return fmin(1, detail / ROUGH);
}

/* Share of the prior in (4). */
static double bars_prior(const struct rec_perturb_fit *fit, double detail)
{
    double weight = fit->unit > 0 ? fit->lambda / fit->unit : 0;
    double over = weight > DULL ? fmin(1, log(weight / DULL) / log(DULLEST / DULL)) : 0;
    return PRIOR * (1 - bars_rough(detail)) * over;
}

void rec_bars_drawn(const struct rec_perturb_fit fit[4], int nch, bool alone, double detail,
                    struct rec_perturbation *p, double by[4])
{
    for (int l = 0; l < nch; l++) {
        p->sigma[l] = sqrt(fit[l].noise2);
        by[l] = alone ? 1 : 1 - (1 - DRAWN) * bars_rough(detail);
        p->prior[l] = alone ? 1 : bars_prior(&fit[l], detail) / by[l];
    }
}

/* D; alone: without J. */
static void bars_draw(rec_bars *b, uint32_t drawn, bool alone, double detail)
{
    double by[4] = {0};
    bars_still(b, 0);
    rec_bars_drawn(b->fit, b->f->nch, alone, detail, &b->p, by);
    for (int l = 0; l < b->f->nch; l++)
        by[l] *= rec_bars_student(drawn) / sqrt(drawn);
    for (b->p.draw = 0; b->p.draw < drawn; b->p.draw++)
        bars_about(b, bars_solve(b), by);
}

/* d = the detail of channel `best` in each channel, from x and its mean; its mean square over that of x, in that channel. */
static double detail_of(size_t best, const float *x, const float *mean, size_t n, size_t cs,
                        float *d)
{
    double d2 = 0, x2 = 0;
    for (size_t i = 0; i < n * cs; i += cs) {
        float usual = mean[i + best], more = usual > 0 ? x[i + best] / usual - 1 : 0;
        for (size_t l = 0; l < cs; l++)
            d[i + l] = more * mean[i + l];
        d2 += (double)d[i + best] * d[i + best];
        x2 += (double)x[i + best] * x[i + best];
    }
    return x2 > 0 ? d2 / x2 : 0;
}

/* f of (5) by the weight alone. */
static double bars_lost(const struct rec_perturb_fit *fit)
{
    return fit->unit > 0 ? LOST * fit->lambda / fit->unit : 0;
}
/* The channel that is known best. */
static size_t bars_best(const struct rec_perturb_fit fit[4], size_t nch)
{
    size_t best = 0;
    for (size_t l = 1; l < nch; l++)
        best = fit[l].g > fit[best].g ? l : best;
    return best;
}

double rec_bars_detail(struct rec_spread *s, const struct rec_perturb_fit fit[4], uint32_t cameras,
                       const float *x, float *mean, float *d)
{
    size_t cs = (size_t)s->a->cs, n = (size_t)s->a->n, nch = cs == 4 ? 3 : 1;
    float by[4] = {0};
    rec_spread_mean(s, x, d);
    rec_spread_mean(s, d, mean);
    double detail = detail_of(bars_best(fit, nch), x, mean, n, cs, d), rough = bars_rough(detail);
    for (size_t l = 0; l < nch; l++) {
        double unseen = UNSEEN * sqrt(bars_gaps(cameras) - 1);
        by[l] = (float)(rough * fmin(MOST, bars_lost(&fit[l]) + unseen));
    }
    for (size_t i = 0; i < n * cs; i++)
        d[i] *= by[i % cs];
    return detail;
}

/* T: the sign of each block.  The deviations of squares stay as they are. */
static void bars_signs(const rec_bars *b, float *d)
{
    const struct rec_grid *g = &b->f->S->grid;
    for (size_t i = 0; i < b->vector; i++) {
        int32_t v = b->f->sub->col[i / b->cs], x = v % g->n[0], y = v / g->n[0] % g->n[1],
                z = v / g->n[0] / g->n[1];
        uint64_t block =
            (uint64_t)(x / BLOCK) | (uint64_t)(y / BLOCK) << 16 | (uint64_t)(z / BLOCK) << 32;
        d[i] = (pvx_mix(block + 1) & 1) != 0 ? d[i] : -d[i];
    }
}

/* Sample variance of the logarithms of the gains that self-calibration has found, over their number. */
static double bars_gains(const rec_frame *f)
{
    const struct rec_selfcal_report *r = &f->report.selfcal;
    double sum = 0, squares = 0, n = 0;
    for (size_t c = 0; c < f->S->n_cameras && r->gain; c++)
        if (f->sub->present[c] && r->camera[c].known) {
            double g = log((double)r->camera[c].gain);
            sum += g;
            squares += g * g;
            n++;
        }
    return n > 1 ? fmax(0, squares - sum * sum / n) / (n - 1) / n : 0;
}

/* S: light of noise, the same in every voxel, and gains. */
static void bars_scale(rec_bars *b)
{
    const float *x = b->f->x, gains = (float)sqrt(bars_gains(b->f));
    float *noise = bars_mode(b, b->out->n_modes++), by[4] = {0};
    double light[4] = {0};
    for (size_t i = 0; i < b->vector; i++)
        light[i % b->cs] += (double)x[i];
    for (int l = 0; l < b->f->nch; l++)
        by[l] = (float)(b->fit[l].excess * light[l] / (double)b->f->sub->n);
    for (size_t i = 0; i < b->vector; i++)
        noise[i] = by[i % b->cs];
    if (!(gains > 0))
        return;
    float *d = bars_mode(b, b->out->n_modes++);
    for (size_t i = 0; i < b->vector; i++)
        d[i] = gains * x[i];
}

/* ---- all of it ----------------------------------------------------------------------------------*/

uint32_t rec_bars_doubt(const struct rec_perturb_fit fit[4], int nch, uint32_t cameras,
                        double detail)
{
    double lost = bars_rough(detail) * bars_lost(&fit[bars_best(fit, (size_t)nch)]);
    uint32_t doubt = cameras < REC_BARS_CAMERAS ? REC_BARS_FEW_CAMERAS : 0;
    for (int l = 0; l < nch; l++)
        if (fit[l].dark2 > 0 && fit[l].noise2 > POOR * fit[l].dark2)
            doubt |= REC_BARS_POOR_FIT;
    doubt |= detail > FINE ? REC_BARS_FINE : 0;
    return lost > BLUR ? doubt | REC_BARS_BLURRED : doubt;
}

pvx_err rec_frame_bars(rec_frame *f, rec_bars *b, uint64_t seed, struct rec_bars_view *out)
{
    uint32_t cameras = 0;
    *out = (struct rec_bars_view){.nch = f->nch, .cs = f->cs, .n = f->sub->n, .index = f->col};
    if (!rec_solver_is_default(f->solver->p.solver) || f->sub->card != NULL)
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
    double detail =
        rec_bars_detail(&b->spread, b->fit, cameras, f->x, b->mean, bars_mode(b, out->n_modes++));
    bars_signs(b, b->modes);
    bars_scale(b);
    if (left > 0)
        bars_leave(b, cameras, left);
    bars_draw(b, few || b->K - left < DRAWS ? b->K - left : DRAWS, few, detail);
    rec_perturb_end(b->perturb);
    rec_spread_deviations(&b->spread, b->modes, out->n_modes, b->sd);
    rec_spread_end(&b->spread);
    out->sd = b->sd;
    out->modes = b->modes;
    out->doubt = rec_bars_doubt(b->fit, f->nch, cameras, detail);
    return PVX_OK;
}
