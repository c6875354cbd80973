/* new.c - the data of the vote that depends on the rig alone, computed once. */
#include <math.h>
#include <stdlib.h>

#include "base/median.h"
#include "base/mem.h"
#include "recon/vote/impl.h"

#define MOST 32 /* bins */

/* Number of floats, rounded up to whole cache lines. */
static size_t padded(size_t n)
{
    return (n + PVX_ALIGN / sizeof(float) - 1) / (PVX_ALIGN / sizeof(float)) *
           (PVX_ALIGN / sizeof(float));
}

static bool new_trials(rec_vote *v)
{
    size_t n = padded(v->voxels), room = padded(v->room), rows = padded(v->tallest * v->widest);
    v->trial = pvx_calloc(v->cameras + 1, sizeof *v->trial);
    v->bytes = ((v->cameras + 1) * (4 * n + 3 * room + rows) + v->cameras * n) * sizeof *v->areas;
    v->areas = pvx_reserve(v->bytes);
    if (v->trial == NULL || v->areas == NULL)
        return false;
    float *at = v->areas;
    for (size_t i = 0; i <= v->cameras; i++) {
        struct rec_trial *t = &v->trial[i];
        float **of_voxels[] = {&t->x, &t->y, &t->step, &t->scale};
        float **of_bins[] = {&t->w, &t->r, &t->wr};
        for (size_t k = 0; k < sizeof of_voxels / sizeof *of_voxels; k++, at += n)
            *of_voxels[k] = at;
        for (size_t k = 0; k < sizeof of_bins / sizeof *of_bins; k++, at += room)
            *of_bins[k] = at;
        t->rows = at;
        at += rows;
    }
    for (size_t c = 0; c < v->cameras; c++, at += n)
        v->length[c] = at;
    return true;
}

static bool new_areas(rec_vote *v)
{
    v->chord = pvx_calloc(v->room, sizeof *v->chord);
    v->b = pvx_calloc(v->room, sizeof *v->b);
    v->use = pvx_calloc(v->room, sizeof *v->use);
    v->lit = pvx_calloc(v->room, 1);
    v->asked = pvx_calloc(v->room, 1);
    size_t merged = 0;
    for (size_t c = 0; c < v->cameras; c++) {
        v->merged_at[c] = merged;
        merged += PVX_ALIGN + (size_t)v->S->block[c].bw; /* threads share no cache line */
    }
    v->merged = pvx_calloc(merged, 1);
    v->col = pvx_calloc(v->voxels, sizeof *v->col);
    v->in_layer = pvx_calloc((size_t)v->level->grid.n[2], sizeof *v->in_layer);
    bool ok = v->chord != NULL && v->b != NULL && v->use != NULL && v->lit != NULL &&
              v->asked != NULL && v->merged != NULL && v->col != NULL && v->in_layer != NULL &&
              new_trials(v);
    for (size_t c = 0; c < v->cameras; c++) {
        const struct rec_sysmat_block *b = &v->level->block[c];
        v->table[c] = pvx_calloc((size_t)(b->bw + 1) * (size_t)(b->bh + 1), sizeof *v->table[c]);
        ok = ok && v->table[c] != NULL;
    }
    return ok;
}

/* K of each camera: s of vote.h from the geometric mean of the voxels' footprints, so that the few
 * beside a camera that stands in the volume do not decide.  The support of a trilinear one is two voxels wide,
 * and that of 2^k side by side, which are a voxel here, is 2^k + 1.  More than MOST bins cost time and tell no more. */
static void new_blur(rec_vote *v)
{
    const double support = v->level->grid.basis == REC_TRILINEAR ? 1 + ldexp(1, -v->shift) : 1;
    for (size_t c = 0; c < v->cameras; c++) {
        double side[2] = {0}, seen = 0;
        v->after_k[c] = 1;
        for (size_t i = 0; i < v->voxels; i++) {
            struct rec_rect r = rec_footprint(v->level, c, (int32_t)i);
            if (!rec_rect_seen(r))
                continue;
            seen++;
            side[0] += log(r.x1 - r.x0);
            side[1] += log(r.y1 - r.y0);
        }
        for (int a = 0; a < 2; a++) {
            double s = seen > 0 ? 2 * floor(exp(side[a] / seen) / support) - 2 : 2;
            s = s < 2 ? 2 : s > MOST ? MOST : s;
            v->blur[c][a] = (int32_t)s;
            v->after_k[c] *= (2 * s * s + 1) / (3 * s * s * s); /* sum of its squared weights */
        }
        if (2 * (size_t)v->blur[c][1] > v->tallest)
            v->tallest = 2 * (size_t)v->blur[c][1];
    }
}

/* The length of each bin's ray in the grid, and the size of a voxel in each camera's picture. */
static pvx_err new_look(rec_vote *v)
{
    struct rec_restrictor *r;
    bool all[REC_MAX_CAMERAS];
    double size[REC_MAX_CAMERAS] = {0}, sorted[REC_MAX_CAMERAS];
    size_t n = 0;
    PVX_TRY(rec_restrictor_new(v->level, &r));
    for (size_t i = 0; i < v->voxels; i++) {
        v->col[i] = (int32_t)i;
        v->trial[0].x[i] = 1;
    }
    for (size_t c = 0; c < v->cameras; c++)
        all[c] = true;
    rec_subsys_restrict(v->sub, r, v->col, (int32_t)v->voxels, all);
    rec_forward_alone(v->sub, v->trial[0].x, v->chord);
    rec_restrictor_free(&r);
    for (size_t c = 0; c < v->cameras; c++) {
        double sum = 0, seen = 0;
        for (size_t i = v->level->row0[c]; i < v->level->row0[c + 1]; i++)
            sum += v->chord[i];
        for (size_t i = 0; i < v->voxels; i++)
            seen += rec_rect_seen(rec_footprint(v->level, c, (int32_t)i));
        size[c] = seen > 0 ? sum / seen : 0;
        if (size[c] > 0)
            sorted[n++] = size[c];
    }
    double middle = pvx_median(sorted, n);
    for (size_t c = 0; c < v->cameras; c++)
        v->weigh[c] = size[c] > 0 ? middle / size[c] : 0;
    return PVX_OK;
}

pvx_err rec_vote_new(const rec_sysmat *S, const struct rec_kernels *k, pvx_pool *pool,
                     uint32_t hold, rec_vote **out)
{
    rec_vote *v = *out = pvx_calloc(1, sizeof *v);
    PVX_NEED(v);
    v->S = v->level = S;
    for (; v->level->coarse != NULL; v->level = v->level->coarse)
        v->shift++;
    v->pool = pool;
    v->hold = hold;
    v->cameras = S->n_cameras;
    v->voxels = rec_grid_count(&v->level->grid);
    v->room = v->level->win.room;
    for (size_t c = 0; c < v->cameras; c++)
        if ((size_t)v->level->block[c].bw > v->widest)
            v->widest = (size_t)v->level->block[c].bw;
    new_blur(v);
    pvx_err e = rec_subsys_new(v->level, k, pool, 1, &v->sub);
    PVX_THEN(e, new_areas(v) ? new_look(v) : PVX_ENOMEM);
    if (e != PVX_OK)
        rec_vote_free(out);
    return e;
}

void rec_vote_free(rec_vote **vp)
{
    rec_vote *v = *vp;
    if (v == NULL)
        return;
    rec_subsys_free(&v->sub);
    for (size_t c = 0; c < v->cameras; c++)
        free(v->table[c]);
    pvx_unreserve(v->areas, v->bytes);
    free(v->trial);
    free(v->chord);
    free(v->b);
    free(v->use);
    free(v->lit);
    free(v->asked);
    free(v->merged);
    free(v->col);
    free(v->in_layer);
    PVX_FREE(*vp);
}
