#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/cli/advise/advise.h"
#include "recon/check/holdout.h"

static const int32_t sides[ADVISE_GRIDS] = {16, 24, 32, 48, 64};
static const struct rec_holdout_params some = {.sets = 3, .views = 12, .step = 1};

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Black level.  A quarter of a picture is dark wherever the flame stands.  That quantile of noise is 0.67 sigma below
 * the level. */
static double dark_level(const rec_unseen *u, size_t c, float *room)
{
    const rec_sysmat *S = rec_unseen_matrix(u);
    size_t n = 0, bins = S->row0[c + 1] - S->row0[c];
    const float *b = rec_unseen_b(u, c), *w = rec_unseen_weight(u, c);
    for (size_t i = 0; i < bins; i++)
        if (w[i] > 0)
            room[n++] = b[i];
    if (n < 16)
        return 0;
    qsort(room, n, sizeof *room, ascending);
    return (double)room[n / 4] + 0.67 * rec_unseen_sigma(u);
}

static void measure_look(const rec_unseen *u, struct advice *a, double count[3], float *room)
{
    const rec_sysmat *S = rec_unseen_matrix(u);
    for (size_t c = 0; c < S->n_cameras; c++) {
        const float *b = rec_unseen_b(u, c), *w = rec_unseen_weight(u, c);
        const uint8_t *lit = rec_unseen_lit(u, c);
        if (!rec_unseen_present(u, c))
            continue;
        for (size_t i = 0; i < S->row0[c + 1] - S->row0[c]; i++) {
            count[0]++;
            count[1] += lit[i];
            count[2] += lit[i] && !(w[i] > 0);
            if (w[i] > 0)
                a->brightest = fmax(a->brightest, (double)b[i]);
        }
        double pedestal, cut = rec_unseen_cut(u, c, &pedestal);
        a->level[c] += dark_level(u, c, room);
        a->cut[c] = fmax(a->cut[c], cut);
        a->pedestal[c] = fmax(a->pedestal[c], pedestal);
    }
}

/* Measure black levels, noise, and the saturated share. */
static pvx_err measure_pictures(rec_unseen *u, struct flame_sets *s, struct advice *a)
{
    struct rec_check_source from = flame_sets_source(s, "pictures");
    double count[3] = {0};
    float *room = pvx_calloc(rec_unseen_matrix(u)->row0[s->rig.n_cameras], sizeof *room);
    pvx_err e = room != NULL ? PVX_OK : PVX_ENOMEM;
    for (size_t i = 0; i < from.n && e == PVX_OK; i++) {
        struct rec_check_set set;
        e = from.get(from.ctx, i, &set);
        if (e == PVX_OK) {
            rec_unseen_load(u, set.picture, set.floats);
            measure_look(u, a, count, room);
            a->sigma += rec_unseen_sigma(u) / (double)from.n;
        }
        if (e == PVX_OK && !from.progress(from.ctx, (double)(i + 1) / (double)from.n))
            e = PVX_ECANCELED;
    }
    free(room);
    a->lit = count[0] > 0 ? count[1] / count[0] : 0;
    a->saturated = count[1] > 0 ? count[2] / count[1] : 0;
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        a->level[c] /= (double)from.n;
        a->darkest = a->level[c] > a->level[a->darkest] ? c : a->darkest;
    }
    return e;
}

const char *advise_exposure(const struct flame_sets *s, const struct advice *a)
{
    bool dim = a->brightest < 0.2 && a->saturated < ADVISE_SATURATED && !s->floats &&
               cap_depth_bits(&s->depth, 1) == 0;
    return dim ? "raise" : a->saturated > 0.05 ? "lower" : "fine";
}

/* Subtract the black levels from the pictures for all that follows. */
static void measure_subtract(struct flame_sets *s, const struct advice *a)
{
    float top = s->floats ? INFINITY : REC_PHOTO_FULL;
    for (size_t i = 0; i < s->n; i++)
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            for (size_t k = 0; k < s->bins[c] && a->level[c] > ADVISE_LEVEL; k++)
                if (s->picture[i][c] != NULL && !(s->picture[i][c][k] >= top))
                    s->picture[i][c][k] -= (float)a->level[c];
}

/* Error of left-out pictures, and time of a solve. */
struct outcome {
    double error, ms;
};

/* Measure with params p, where the volume is of every step-th of the other cameras. */
static pvx_err with(struct flame_sets *s, const struct advice *a, const struct rec_unseen_params *p,
                    size_t step, const char *label, struct outcome *o, struct pvx_diag *d)
{
    struct rec_check_source from = flame_sets_source(s, label);
    struct rec_holdout_params how = some;
    rec_unseen *u;
    how.step = step;
    how.absorption = a->absorption.c;
    PVX_TRY(rec_unseen_new(&s->rig, p, s->pool, &u, d));
    pvx_err e = rec_holdout(u, &from, &how, &o->error, &o->ms);
    rec_unseen_free(&u);
    return e == PVX_ENOENT
               ? pvx_fail(d, e,
                          "%s: no flame that three cameras besides a fourth see; is it --black?",
                          s->a->frames)
               : e;
}

/* Measure all grids with the rig's basis, then the other basis on the grid of the check. */
static pvx_err measure_grids(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    enum rec_basis own = s->rig.grid.basis, other = own == REC_BOX ? REC_TRILINEAR : REC_BOX;
    struct outcome o = {0};
    double best = INFINITY;
    for (; a->n_grids < ADVISE_GRIDS; a->n_grids++) {
        struct advise_grid *g = &a->grid[a->n_grids];
        struct rec_unseen_params p = s->params;
        char label[32];
        p.voxels = g->voxels = sides[a->n_grids];
        snprintf(label, sizeof label, "%d voxels", g->voxels);
        PVX_TRY(with(s, a, &p, 1, label, &o, d));
        g->error = o.error;
        g->ms = o.ms;
        best = fmin(best, g->error);
        if (g->voxels == s->params.voxels)
            a->basis[own] = g->error;
    }
    while (a->grid[a->best_grid].error > ADVISE_SAME * best)
        a->best_grid++;
    a->all = a->grid[a->best_grid].error;
    s->rig.grid.basis = other;
    pvx_err e = with(s, a, &s->params, 1, rec_basis_name(other), &o, d);
    a->basis[other] = o.error;
    s->rig.grid.basis = own;
    return e;
}

pvx_err advise_terms(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    rec_unseen *u;
    float came[REC_MAX_CAMERAS][3];
    *a = (struct advice){0};
    PVX_TRY(rec_unseen_new(&s->rig, &s->params, s->pool, &u, d));
    pvx_err e = measure_pictures(u, s, a);
    if (e == PVX_OK && a->level[a->darkest] > ADVISE_LEVEL) { /* subtracted from now on */
        struct advice without = {0};
        measure_subtract(s, a);
        e = measure_pictures(u, s, &without);
        a->lit = without.lit;
        a->saturated = without.saturated;
    }
    rec_unseen_free(&u);
    s->params.at_least = a->saturated > ADVISE_SATURATED;
    PVX_THEN(e, advise_bodies(s, a->body, d));
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        memcpy(came[c], s->rig.cameras[c].gain, sizeof came[c]);
    PVX_THEN(e, advise_light(s, a, d));
    PVX_THEN(e, advise_response(s, a, d));
    if (e != PVX_OK || !a->response.on)
        return e;
    advise_straighten(s, a->response.power);
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        memcpy(s->rig.cameras[c].gain, came[c], sizeof came[c]);
    return advise_light(s, a, d);
}

/* Find the margin of silhouettes.  A larger one than needed lets in ghosts, a smaller one cuts the flame. */
static pvx_err margins(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct outcome o = {0};
    double best = INFINITY;
    for (int32_t m = 0; m < ADVISE_MARGINS; m++) {
        struct rec_unseen_params p = s->params;
        p.margin = m;
        PVX_TRY(with(s, a, &p, 1, "margin", &o, d));
        a->margin[m] = o.error;
        best = fmin(best, a->margin[m]);
    }
    while (a->margin[a->best_margin] > ADVISE_SAME * best)
        a->best_margin++;
    return PVX_OK;
}

/* Convert the margin to bins of the advised grid. */
static pvx_err configured(const struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    const struct rec_sysmat_params p = {.binning = 0, .rays_per_bin = s->params.rays};
    struct rec_sysmat_params got;
    struct rec_rig rig = s->rig; /* only its grid is changed */
    struct rec_grid *g = &rig.grid;
    double longest = 0;
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, g->max[k] - g->min[k]);
    for (int k = 0; k < 3; k++)
        g->n[k] = (int32_t)fmax(
            4, ceil((g->max[k] - g->min[k]) / longest * a->grid[a->best_grid].voxels - 1e-6));
    PVX_TRY(rec_sysmat_resolve(&rig, &p, &got, d));
    a->margin_bins = (a->best_margin * s->params.binning + got.binning - 1) / got.binning;
    return PVX_OK;
}

/* Measure whether every second camera would be enough. */
static pvx_err measure_cameras(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct rec_unseen_params p = s->params;
    struct outcome o = {.error = a->all};
    p.voxels = a->grid[a->best_grid].voxels;
    if (s->rig.n_cameras >= 7)
        PVX_TRY(with(s, a, &p, 2, "half the cameras", &o, d));
    a->half = o.error;
    return PVX_OK;
}

pvx_err advise_measure(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    int32_t n[3];
    PVX_TRY(advise_terms(s, a, d));
    PVX_TRY(advise_motion(s, a, d));
    PVX_TRY(margins(s, a, d));
    PVX_TRY(measure_grids(s, a, d));
    PVX_TRY(measure_cameras(s, a, d));
    PVX_TRY(configured(s, a, d));
    if (rec_rig_finest(&s->rig, s->params.binning, n) == PVX_OK)
        for (int k = 0; k < 3; k++)
            a->finest = n[k] > a->finest ? n[k] : a->finest;
    return PVX_OK;
}
