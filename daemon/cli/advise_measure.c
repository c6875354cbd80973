#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/advise.h"
#include "recon/check/holdout.h"

static const int32_t sides[ADVISE_GRIDS] = {16, 24, 32, 48, 64};
static const struct rec_holdout_params some = {.sets = 3, .views = 12, .step = 1};

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* A quarter of a picture is dark wherever the flame stands: that quantile of noise is 0.67 sigma below the level. */
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

static void look(const rec_unseen *u, struct advice *a, double count[3], float *room)
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
        a->level[c] += dark_level(u, c, room);
    }
}

/* Levels, noise, what is saturated. */
static pvx_err pictures(rec_unseen *u, struct flame_sets *s, struct advice *a)
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
            look(u, a, count, room);
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

/* What follows sees the pictures as they are once black is subtracted. */
static void subtract(struct flame_sets *s, const struct advice *a)
{
    float top = s->floats ? INFINITY : REC_PHOTO_FULL;
    for (size_t i = 0; i < s->n; i++)
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            for (size_t k = 0; k < s->bins[c] && a->level[c] > ADVISE_LEVEL; k++)
                if (s->picture[i][c] != NULL && !(s->picture[i][c][k] >= top))
                    s->picture[i][c][k] -= (float)a->level[c];
}

/* Error of left-out pictures on a grid of its own. */
static pvx_err on_grid(struct flame_sets *s, int32_t voxels, size_t step, const char *label,
                       double *error, double *ms, struct pvx_diag *d)
{
    struct rec_unseen_params p = s->params;
    struct rec_check_source from = flame_sets_source(s, label);
    struct rec_holdout_params how = some;
    rec_unseen *u;
    p.voxels = voxels;
    how.step = step;
    PVX_TRY(rec_unseen_new(&s->rig, &p, s->pool, &u, d));
    pvx_err e = rec_holdout(u, &from, &how, error, ms);
    rec_unseen_free(&u);
    return e == PVX_ENOENT
               ? pvx_fail(d, e,
                          "%s: no flame that three cameras besides a fourth see; is it --black?",
                          s->a->frames)
               : e;
}

/* The grids by the rig's basis, then the other basis on that of the check. */
static pvx_err grids(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    enum rec_basis own = s->rig.grid.basis, other = own == REC_BOX ? REC_TRILINEAR : REC_BOX;
    double best = INFINITY, ms;
    for (; a->n_grids < ADVISE_GRIDS; a->n_grids++) {
        struct advise_grid *g = &a->grid[a->n_grids];
        char label[32];
        g->voxels = sides[a->n_grids];
        snprintf(label, sizeof label, "%d voxels", g->voxels);
        PVX_TRY(on_grid(s, g->voxels, 1, label, &g->error, &g->ms, d));
        best = fmin(best, g->error);
        if (g->voxels == s->params.voxels)
            a->basis[own] = g->error;
    }
    while (a->grid[a->best_grid].error > ADVISE_SAME * best)
        a->best_grid++;
    a->all = a->grid[a->best_grid].error;
    s->rig.grid.basis = other;
    pvx_err e = on_grid(s, s->params.voxels, 1, rec_basis_name(other), &a->basis[other], &ms, d);
    s->rig.grid.basis = own;
    return e;
}

pvx_err advise_measure(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    double ms;
    int32_t n[3];
    rec_unseen *u;
    *a = (struct advice){0};
    PVX_TRY(rec_unseen_new(&s->rig, &s->params, s->pool, &u, d));
    pvx_err e = pictures(u, s, a);
    rec_unseen_free(&u);
    if (e == PVX_OK)
        subtract(s, a);
    if (e == PVX_OK)
        e = advise_light(s, a, d);
    if (e == PVX_OK)
        e = grids(s, a, d);
    a->half = a->all;
    if (e == PVX_OK && s->rig.n_cameras >= 7)
        e = on_grid(s, a->grid[a->best_grid].voxels, 2, "half the cameras", &a->half, &ms, d);
    if (e == PVX_OK && rec_rig_finest(&s->rig, s->params.binning, n) == PVX_OK)
        for (int k = 0; k < 3; k++)
            a->finest = n[k] > a->finest ? n[k] : a->finest;
    return e;
}
