#include "recon/levels.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/simd/lanes.h"

#define MAX_LEVELS 10
#define ITERATIONS 14
#define AT_FIRST   6 /* on the coarsest level: it is good enough to start the next, and soon */
#define TOLERANCE  1e-3f

struct level {
    const rec_sysmat *S;
    struct rec_subsys *sub;
    rec_solver *solver;
    int32_t *map;   /* [nz+2][ny+2][nx+2] 1 + number of the active column, 0 = not active; the rim
                      saves every neighbour its bounds check */
    int32_t *slab;  /* [N] columns of each layer of voxels, from the layer's start */
    int32_t *col;   /* [N] all of them, ascending */
    int32_t *first; /* [nz+1] active columns before a layer */
    float *b;       /* [rowspace][cs], filled where sub has rows */
    float *w;       /* [rowspace], with lanes [rowspace][4] */
    float *x;       /* [1+N][cs]: zero, then the solution, so that map leads to a value always */
};

struct rec_levels {
    pvx_pool *pool;
    int cs, n;
    bool lanes;                  /* as rec_levels_restrict was told */
    struct level at[MAX_LEVELS]; /* 0: twice the voxel size */
};

static size_t map_size(const struct rec_grid *g)
{
    return (size_t)(g->n[0] + 2) * (size_t)(g->n[1] + 2) * (size_t)(g->n[2] + 2);
}

static pvx_err level_new(struct level *v, const rec_sysmat *S, const struct rec_kernels *k,
                         pvx_pool *pool, int nch, int cs)
{
    size_t voxels = rec_grid_count(&S->grid), rows = S->row0[S->n_cameras];
    v->S = S;
    v->map = pvx_calloc(map_size(&S->grid), sizeof *v->map);
    v->slab = pvx_calloc(voxels, sizeof *v->slab);
    v->col = pvx_calloc(voxels, sizeof *v->col);
    v->first = pvx_calloc((size_t)S->grid.n[2] + 1, sizeof *v->first);
    v->b = pvx_calloc(rows * (size_t)cs, sizeof *v->b);
    v->w = pvx_calloc(rows * (size_t)cs, sizeof *v->w);
    v->x = pvx_calloc((voxels + 1) * (size_t)cs, sizeof *v->x);
    if (v->map == NULL || v->slab == NULL || v->col == NULL || v->first == NULL || v->b == NULL ||
        v->w == NULL || v->x == NULL)
        return PVX_ENOMEM;
    pvx_err e = rec_subsys_new(S, k, pool, cs, &v->sub);
    return e != PVX_OK ? e : rec_solver_new(S, nch, &v->solver);
}

pvx_err rec_levels_new(const rec_sysmat *S, const struct rec_kernels *k, pvx_pool *pool, int nch,
                       rec_levels **out)
{
    *out = NULL;
    if (S->coarse == NULL)
        return PVX_OK;
    rec_levels *l = pvx_calloc(1, sizeof *l);
    if (l == NULL)
        return PVX_ENOMEM;
    l->pool = pool;
    l->cs = nch == 3 ? 4 : 1;
    pvx_err e = PVX_OK;
    for (const rec_sysmat *c = S->coarse; c != NULL && l->n < MAX_LEVELS && e == PVX_OK;
         c = c->coarse)
        e = level_new(&l->at[l->n++], c, k, pool, nch, l->cs);
    if (e != PVX_OK) {
        rec_levels_free(&l);
        return e;
    }
    *out = l;
    return PVX_OK;
}

void rec_levels_free(rec_levels **lp)
{
    rec_levels *l = *lp;
    if (l == NULL)
        return;
    for (int i = 0; i < l->n; i++) {
        struct level *v = &l->at[i];
        free(v->map);
        free(v->slab);
        free(v->col);
        free(v->first);
        free(v->b);
        free(v->w);
        free(v->x);
        rec_subsys_free(&v->sub);
        rec_solver_free(&v->solver);
    }
    free(l);
    *lp = NULL;
}

/* ---- columns ------------------------------------------------------------------------------------*/

struct walk {
    rec_levels *l;
    struct level *v;
    const struct rec_grid *fine;
    const int32_t *col; /* of the finer level */
    int32_t n;
    float *x;                       /* of the finer level */
    int shift;                      /* this level's bins are 2^shift fine bins wide */
    const struct rec_subsys *image; /* whose bins those are */
    const float *b, *w;
};

static size_t map_index(const struct rec_grid *g, int32_t i, int32_t j, int32_t k)
{
    return ((size_t)(k + 1) * (size_t)(g->n[1] + 2) + (size_t)(j + 1)) * (size_t)(g->n[0] + 2) +
           (size_t)(i + 1);
}

/* Layer k of the coarse grid: mark the parents of the fine voxels in its two layers, list them. */
static void mark_layer(void *ctx, size_t task)
{
    struct walk *t = ctx;
    const struct rec_grid *g = &t->v->S->grid, *f = t->fine;
    int32_t k = (int32_t)task, wide = g->n[0] + 2, layer = f->n[0] * f->n[1];
    int32_t *map = t->v->map + map_index(g, -1, -1, k), n = 0;
    int32_t *list = t->v->slab + rec_grid_index(g, 0, 0, k);
    memset(map, 0, (size_t)wide * (size_t)(g->n[1] + 2) * sizeof *map);
    int32_t q = rec_first_column(t->col, t->n, 2 * k * layer);
    int32_t end = 2 * k + 2 >= f->n[2] ? t->n : rec_first_column(t->col, t->n, (2 * k + 2) * layer);
    for (int32_t row = -1, base = 0; q < end; q++) {
        if (t->col[q] < row || t->col[q] >= row + f->n[0] || row < 0) { /* another row of voxels */
            int32_t ijk[3];
            rec_grid_ijk(f, t->col[q], ijk);
            row = t->col[q] - ijk[0];
            base = (ijk[1] / 2 + 1) * wide + 1;
        }
        map[base + (t->col[q] - row) / 2] = 1;
    }
    for (int32_t j = 0; j < g->n[1]; j++)
        for (int32_t i = 0; i < g->n[0]; i++)
            if (map[(j + 1) * wide + i + 1])
                list[n++] = rec_grid_index(g, i, j, k);
    t->v->first[k + 1] = n;
}

/* The layer's list to its place, and its numbers into the map. */
static void number_layer(void *ctx, size_t task)
{
    struct walk *t = ctx;
    const struct rec_grid *g = &t->v->S->grid;
    int32_t k = (int32_t)task, q = t->v->first[k], n = t->v->first[k + 1] - q;
    const int32_t *list = t->v->slab + rec_grid_index(g, 0, 0, k);
    memcpy(t->v->col + q, list, (size_t)n * sizeof *list);
    for (int32_t i = 0; i < n; i++) {
        int32_t ijk[3];
        rec_grid_ijk(g, list[i], ijk);
        t->v->map[map_index(g, ijk[0], ijk[1], ijk[2])] = q + i + 1;
    }
}

/* ---- pictures -----------------------------------------------------------------------------------*/

/* The fine bins of a coarse one, fewer at the image's border: rows of `wide`, `pitch` apart. */
struct patch {
    size_t first, wide, high, pitch;
};
REC_INLINE struct patch patch_of(const struct walk *t, size_t c, uint32_t ray)
{
    const struct rec_subsys *a = t->v->sub, *f = t->image;
    size_t bw = (size_t)a->S->block[c].bw, fw = (size_t)f->S->block[c].bw;
    size_t fh = (size_t)f->S->block[c].bh, side = (size_t)1 << t->shift;
    size_t r = ray - a->row0[c], y0 = r / bw << t->shift, x0 = r % bw << t->shift;
    return (struct patch){.first = f->row0[c] + y0 * fw + x0,
                          .wide = x0 + side < fw ? side : fw - x0,
                          .high = y0 + side < fh ? side : fh - y0,
                          .pitch = fw};
}

/* Mean of a patch, which is row `ray` of the level; a bin that was not measured is left out, and a mean of
 * fewer than half of its bins does not count. */
REC_INLINE void average(const struct walk *t, const struct patch *p, uint32_t ray, size_t cs)
{
    rec_f4 sum = {0};
    float weight = 0;
    for (size_t y = 0; y < p->high; y++)
        for (size_t x = 0; x < p->wide; x++) {
            size_t at = p->first + y * p->pitch + x;
            sum += rec_splat(t->w[at]) * rec_ld(t->b, at, cs);
            weight += t->w[at];
        }
    float share = weight / (float)(p->wide * p->high);
    bool use = share >= 0.5f;
    t->v->w[ray] = use ? share : 0;
    sum *= rec_splat(use ? 1 / weight : 0);
    rec_st(t->v->b, ray, cs, sum);
}
/* The same where bins have weights per channel: a mean is that of the bins that measured the channel, its
 * weight their part of all, as the sum over the bins themselves would have it. */
REC_INLINE void average_lanes(const struct walk *t, const struct patch *p, uint32_t ray)
{
    rec_f4 sum = {0}, weight = {0}, zero = {0};
    int measured = 0, bins = (int)(p->wide * p->high);
    for (size_t y = 0; y < p->high; y++)
        for (size_t x = 0; x < p->wide; x++) {
            size_t at = p->first + y * p->pitch + x;
            rec_f4 w = rec_ld(t->w, at, 4);
            sum += w * rec_ld(t->b, at, 4);
            weight += w;
            measured += rec_any(w > 0);
        }
    rec_i4 use = (weight > 0) & (2 * measured >= bins ? (rec_i4){-1, -1, -1, -1} : (rec_i4){0});
    rec_st(t->v->w, ray, 4, rec_select(use, weight / rec_splat((float)bins), zero));
    rec_st(t->v->b, ray, 4, rec_select(use, sum / weight, zero));
}

/* The rows of a chunk; with `lanes` of weights per channel. */
REC_INLINE void averages(const struct walk *t, size_t chunk, size_t cs, bool lanes)
{
    const struct rec_subsys *a = t->v->sub;
    int32_t i0, i1;
    size_t c = 0;
    rec_chunk_range(a->rows, chunk, &i0, &i1);
    for (int32_t i = i0; i < i1; i++) {
        while (a->ray[i] >= a->row0[c + 1])
            c++;
        const struct patch p = patch_of(t, c, a->ray[i]);
        if (lanes)
            average_lanes(t, &p, a->ray[i]);
        else
            average(t, &p, a->ray[i], cs);
    }
}
static void average_chunk(void *ctx, size_t k)
{
    const struct walk *t = ctx;
    if (t->l->lanes)
        averages(t, k, 4, true);
    else
        t->l->cs == 4 ? averages(t, k, 4, false) : averages(t, k, 1, false);
}

void rec_levels_restrict(rec_levels *l, const struct rec_subsys *fine, const float *b,
                         const float *w, bool lanes)
{
    l->lanes = lanes;
    struct walk t = {.l = l,
                     .col = fine->col,
                     .n = fine->n,
                     .fine = &fine->S->grid,
                     .image = fine,
                     .b = b,
                     .w = w};
    for (int i = 0; i < l->n; i++) {
        struct level *v = &l->at[i];
        int32_t layers = v->S->grid.n[2];
        t.v = v;
        t.shift = i + 1;
        pvx_pool_run(l->pool, (size_t)layers, mark_layer, &t);
        for (int32_t k = 0; k < layers; k++)
            v->first[k + 1] += v->first[k];
        pvx_pool_run(l->pool, (size_t)layers, number_layer, &t);
        rec_subsys_restrict(v->sub, v->col, v->first[layers], fine->present);
        pvx_pool_run(l->pool, rec_chunks(v->sub->rows), average_chunk, &t);
        t.col = v->col;
        t.n = v->first[layers];
        t.fine = &v->S->grid;
    }
}

/* ---- finer again --------------------------------------------------------------------------------*/

/* (1) along x, y, z for one coarse voxel: 27 values in, 8 children out, x fastest in both. */
REC_INLINE void split(const rec_f4 in[27], rec_f4 out[8])
{
    rec_f4 x[2][9], y[4][3], eighth = rec_splat(0.125f);
    for (int r = 0; r < 9; r++) {
        rec_f4 d = eighth * (in[3 * r + 2] - in[3 * r]);
        x[0][r] = in[3 * r + 1] - d;
        x[1][r] = in[3 * r + 1] + d;
    }
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 2; i++) {
            rec_f4 d = eighth * (x[i][3 * k + 2] - x[i][3 * k]);
            y[i][k] = x[i][3 * k + 1] - d;
            y[2 + i][k] = x[i][3 * k + 1] + d;
        }
    for (int i = 0; i < 4; i++) {
        rec_f4 d = eighth * (y[i][2] - y[i][0]);
        out[i] = y[i][1] - d;
        out[4 + i] = y[i][1] + d;
    }
}

/* Children of the coarse columns of layer k.  The four rows of fine voxels that a row of coarse ones
 * has are walked along with it. */
REC_INLINE void refine(const struct walk *t, int32_t k, size_t cs)
{
    const struct level *v = t->v;
    const struct rec_grid *g = &v->S->grid, *f = t->fine;
    size_t wide = (size_t)g->n[0] + 2, layer = wide * (size_t)(g->n[1] + 2);
    int32_t at[4] = {0}, start[4] = {0}, row = -1;
    for (int32_t q = v->first[k]; q < v->first[k + 1]; q++) {
        if (row < 0 || v->col[q] >= row + g->n[0]) {
            int32_t ijk[3];
            rec_grid_ijk(g, v->col[q], ijk);
            row = v->col[q] - ijk[0];
            for (int s = 0; s < 4; s++) {
                int32_t j = 2 * ijk[1] + (s & 1), z = 2 * k + (s >> 1);
                bool in = j < f->n[1] && z < f->n[2];
                start[s] = in ? rec_grid_index(f, 0, j, z) : -1;
                at[s] = in ? rec_first_column(t->col, t->n, start[s]) : t->n;
            }
        }
        int32_t i = v->col[q] - row;
        const int32_t *map = v->map + map_index(g, i, (row / g->n[0]) % g->n[1], k);
        rec_f4 in[27], out[8];
        for (int z = -1, o = 0; z <= 1; z++)
            for (int y = -1; y <= 1; y++) {
                const int32_t *m = map + z * (ptrdiff_t)layer + y * (ptrdiff_t)wide;
                for (int x = -1; x <= 1; x++, o++)
                    in[o] = rec_ld(v->x, (size_t)m[x], cs);
            }
        split(in, out);
        for (int s = 0; s < 4; s++)
            for (int c = 0; c < 2; c++) {
                int32_t voxel = start[s] + 2 * i + c;
                while (at[s] < t->n && t->col[at[s]] < voxel)
                    at[s]++;
                if (at[s] < t->n && t->col[at[s]] == voxel && 2 * i + c < f->n[0]) {
                    rec_f4 o = out[2 * s + c];
                    rec_st(t->x, (size_t)at[s], cs, rec_select(o > 0, o, (rec_f4){0}));
                }
            }
    }
}
static void refine_layer(void *ctx, size_t k)
{
    const struct walk *t = ctx;
    t->l->cs == 4 ? refine(t, (int32_t)k, 4) : refine(t, (int32_t)k, 1);
}

void rec_levels_solve(rec_levels *l, const struct rec_subsys *fine, const double weight[4],
                      int64_t deadline_ns, float *x, uint32_t *iterations, double misfit2[4])
{
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report report;
    double share[4];
    p.tolerance = TOLERANCE;
    p.deadline_ns = deadline_ns;
    p.weight = share;
    p.lanes = l->lanes;
    *iterations = 0;
    for (int i = l->n - 1; i >= 0; i--) {
        struct level *v = &l->at[i];
        size_t cs = (size_t)l->cs;
        float *vx = v->x + cs;
        for (int c = 0; c < 4; c++)
            share[c] = weight[c] / (double)((uint64_t)1 << 3 * (i + 1));
        if (i == l->n - 1)
            memset(vx, 0, (size_t)v->sub->n * cs * sizeof *vx);
        p.good_start = i < l->n - 1;
        p.iterations = i < l->n - 1 || i == 0 ? ITERATIONS : AT_FIRST;
        pvx_err e = rec_solve(v->solver, v->sub, v->b, v->w, -1, &p, vx, NULL, NULL, &report);
        if (e != PVX_OK) /* an unknown solver, which the default is not */
            memset(vx, 0, (size_t)v->sub->n * cs * sizeof *vx);
        *iterations += report.iterations;
        memcpy(misfit2, report.misfit2, sizeof report.misfit2);
        struct level *finer = i > 0 ? &l->at[i - 1] : NULL;
        struct walk t = {.l = l,
                         .v = v,
                         .fine = finer ? &finer->S->grid : &fine->S->grid,
                         .col = finer ? finer->col : fine->col,
                         .n = finer ? finer->sub->n : fine->n,
                         .x = finer ? finer->x + cs : x};
        pvx_pool_run(l->pool, (size_t)v->S->grid.n[2], refine_layer, &t);
    }
}
