#include "recon/solve/levels.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/solve/card.h"
#include "recon/solve/selfcal.h"
#include "recon/solve/start.h"

#define MAX_LEVELS 10
#define ITERATIONS 24
#define AT_FIRST   6 /* on the coarsest level: good enough to start the next one early */
#define TOLERANCE  2e-3f
#define RENEWALS   1 /* of V and lambda: the next grid renews them from better volumes */

struct level {
    const rec_sysmat *S;
    struct rec_subsys *sub;
    int32_t *map;   /* [nz+2][ny+2][nx+2] 1 + number of the active column, 0 = not active; the rim
                      avoids bounds checks at the neighbours */
    int32_t *col;   /* [N] active columns, ascending */
    int32_t *first; /* [nz+1] active columns before a layer */
    float *b;       /* [rowspace][cs], filled where sub has rows */
    float *w;       /* [rowspace], per channel [rowspace][4] */
    size_t bytes;   /* of map, col, b and w, which are one piece of reserved memory */
    void *areas;
};

struct rec_levels {
    pvx_pool *pool;
    int cs, n;
    bool per_channel;            /* as given to rec_levels_restrict */
    struct level at[MAX_LEVELS]; /* 0: twice the voxel size */
};

static size_t map_size(const struct rec_grid *g)
{
    return (size_t)(g->n[0] + 2) * (size_t)(g->n[1] + 2) * (size_t)(g->n[2] + 2);
}

static pvx_err level_new(struct level *v, const rec_sysmat *S, const struct rec_kernels *k,
                         pvx_pool *pool, int cs)
{
    size_t floats = S->row0[S->n_cameras] * (size_t)cs; /* of b; as many of w */
    v->S = S;
    v->bytes = (2 * floats + map_size(&S->grid) + rec_grid_count(&S->grid)) * sizeof(float);
    v->areas = pvx_reserve(v->bytes);
    v->first = pvx_calloc((size_t)S->grid.n[2] + 1, sizeof *v->first);
    if (v->areas == NULL || v->first == NULL)
        return PVX_ENOMEM;
    v->b = v->areas;
    v->w = v->b + floats;
    v->map = (int32_t *)(v->w + floats);
    v->col = v->map + map_size(&S->grid);
    return rec_subsys_new(S, k, pool, cs, &v->sub);
}

pvx_err rec_levels_new(const rec_sysmat *S, const struct rec_kernels *k, pvx_pool *pool, int cs,
                       rec_levels **out)
{
    *out = NULL;
    if (S->coarse == NULL)
        return PVX_OK;
    rec_levels *l = pvx_calloc(1, sizeof *l);
    if (l == NULL)
        return PVX_ENOMEM;
    l->pool = pool;
    l->cs = cs;
    pvx_err e = PVX_OK;
    for (const rec_sysmat *c = S->coarse; c != NULL && l->n < MAX_LEVELS && e == PVX_OK;
         c = c->coarse)
        e = level_new(&l->at[l->n++], c, k, pool, cs);
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
        pvx_unreserve(v->areas, v->bytes);
        free(v->first);
        rec_subsys_free(&v->sub);
    }
    free(l);
    *lp = NULL;
}

static size_t solution_bytes(const struct rec_descent *d)
{
    return (1 + d->voxels) * (size_t)d->cs * sizeof(float);
}

pvx_err rec_descent_init(struct rec_descent *d, const rec_sysmat *S, int nch)
{
    *d = (struct rec_descent){.cs = nch == 3 ? 4 : 1, .voxels = rec_grid_count(&S->grid)};
    PVX_TRY(rec_problem_new(S->coarse, nch, &d->problem));
    for (int i = 0; i < 2; i++)
        d->x[i] = pvx_reserve(solution_bytes(d));
    d->spare = pvx_reserve(solution_bytes(d));
    if (d->x[0] != NULL && d->x[1] != NULL && d->spare != NULL)
        return PVX_OK;
    rec_descent_fini(d);
    return PVX_ENOMEM;
}

void rec_descent_fini(struct rec_descent *d)
{
    rec_problem_free(&d->problem);
    for (int i = 0; i < 2; i++)
        pvx_unreserve(d->x[i], solution_bytes(d));
    pvx_unreserve(d->spare, solution_bytes(d));
    *d = (struct rec_descent){0};
}

/* ---- columns ------------------------------------------------------------------------------------*/

struct walk {
    const struct level *v;
    const struct rec_grid *fine;
    const int32_t *col; /* of the finer level */
    int32_t n;
    int32_t *list;                  /* columns of each layer of voxels, from the layer's start */
    const float *coarse;            /* x of this level, after one zero */
    float *x;                       /* x of the finer level */
    int shift;                      /* this level's bins are 2^shift fine bins wide */
    const struct rec_subsys *image; /* the system that has those fine bins */
    const struct rec_pictures *in;
};

static size_t map_index(const struct rec_grid *g, int32_t i, int32_t j, int32_t k)
{
    return ((size_t)(k + 1) * (size_t)(g->n[1] + 2) + (size_t)(j + 1)) * (size_t)(g->n[0] + 2) +
           (size_t)(i + 1);
}

/* Layer k of the coarse grid: marks the parents of the fine voxels in its two layers and lists them. */
static void levels_mark_layer(void *ctx, size_t task)
{
    struct walk *t = ctx;
    const struct rec_grid *g = &t->v->S->grid, *f = t->fine;
    int32_t k = (int32_t)task, wide = g->n[0] + 2, layer = f->n[0] * f->n[1];
    int32_t *map = t->v->map + map_index(g, -1, -1, k), n = 0;
    int32_t *list = t->list + rec_grid_index(g, 0, 0, k);
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

/* Copies the list of the layer to its place, and writes its numbers into the map. */
static void number_layer(void *ctx, size_t task)
{
    struct walk *t = ctx;
    const struct rec_grid *g = &t->v->S->grid;
    int32_t k = (int32_t)task, q = t->v->first[k], n = t->v->first[k + 1] - q;
    const int32_t *list = t->list + rec_grid_index(g, 0, 0, k);
    memcpy(t->v->col + q, list, (size_t)n * sizeof *list);
    for (int32_t i = 0; i < n; i++) {
        int32_t ijk[3];
        rec_grid_ijk(g, list[i], ijk);
        t->v->map[map_index(g, ijk[0], ijk[1], ijk[2])] = q + i + 1;
    }
}

/* ---- pictures -----------------------------------------------------------------------------------*/

/* The fine bins of a coarse one (fewer at the image's border): `high` rows of `wide` bins, `pitch` apart. */
struct patch {
    size_t first, wide, high, pitch;
};
REC_INLINE struct patch patch_of(const struct walk *t, size_t c, size_t ray)
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

/* Row `ray` of the level: the mean of a patch without the bins that were not measured.  The mean has no weight if
 * fewer than half of the bins were measured. */
REC_INLINE void average(const struct walk *t, const struct patch *p, size_t ray, size_t cs)
{
    rec_f4 sum = {0};
    float weight = 0;
    size_t measured = 0, bins = p->wide * p->high;
    for (size_t y = 0; y < p->high; y++)
        for (size_t x = 0; x < p->wide; x++) {
            size_t at = p->first + y * p->pitch + x;
            sum += rec_splat(t->in->w[at]) * rec_ld(t->in->b, at, cs);
            weight += t->in->w[at];
            measured += t->in->w[at] > 0;
        }
    bool use = measured > 0 && 2 * measured >= bins;
    t->v->w[ray] = use ? weight / (float)bins : 0;
    sum *= rec_splat(use ? 1 / weight : 0);
    rec_st(t->v->b, ray, cs, sum);
}
/* The same for weights per channel: the mean of a channel is over the bins that measured it, and its weight is their
 * share of all bins, as in the sum over the bins themselves. */
REC_INLINE void average_channels(const struct walk *t, const struct patch *p, size_t ray)
{
    rec_f4 sum = {0}, weight = {0}, zero = {0};
    int measured = 0, bins = (int)(p->wide * p->high);
    for (size_t y = 0; y < p->high; y++)
        for (size_t x = 0; x < p->wide; x++) {
            size_t at = p->first + y * p->pitch + x;
            rec_f4 w = rec_ld(t->in->w, at, 4);
            sum += w * rec_ld(t->in->b, at, 4);
            weight += w;
            measured += rec_any(w > 0);
        }
    rec_i4 use = (weight > 0) & (2 * measured >= bins ? (rec_i4){-1, -1, -1, -1} : (rec_i4){0});
    rec_st(t->v->w, ray, 4, rec_select(use, weight / rec_splat((float)bins), zero));
    rec_st(t->v->b, ray, 4, rec_select(use, sum / weight, zero));
}

/* The rows of a chunk; per_channel: with weights per channel. */
REC_INLINE void averages(const struct walk *t, size_t chunk, size_t cs, bool per_channel)
{
    const struct rec_subsys *a = t->v->sub;
    size_t c = 0;
    REC_FOR_ROWS (i, a, chunk) {
        if (!a->is_row[i])
            continue;
        while (i >= a->row0[c + 1])
            c++;
        const struct patch p = patch_of(t, c, i);
        if (per_channel)
            average_channels(t, &p, i);
        else
            average(t, &p, i, cs);
    }
}
static void average_chunk(void *ctx, size_t k)
{
    const struct walk *t = ctx;
    t->in->per_channel   ? averages(t, k, 4, true)
    : t->v->sub->cs == 4 ? averages(t, k, 4, false)
                         : averages(t, k, 1, false);
}

/* The same on a card. */
static void levels_restrict_there(rec_levels *l, const struct rec_subsys *fine,
                                  const struct rec_pictures *in)
{
    struct rec_card_level level[MAX_LEVELS];
    for (int i = 0; i < l->n; i++) {
        struct level *v = &l->at[i];
        level[i] = (struct rec_card_level){v->sub, v->b, v->w, v->col};
    }
    rec_card_of(fine)->levels(fine, in, level, l->n);
}

void rec_levels_restrict(rec_levels *l, struct rec_restrictor *r, const struct rec_subsys *fine,
                         const struct rec_pictures *in)
{
    l->per_channel = in->per_channel;
    if (fine->card != NULL) {
        levels_restrict_there(l, fine, in);
        return;
    }
    struct walk t = {.list = r->list,
                     .col = fine->col,
                     .n = fine->n,
                     .fine = &fine->S->grid,
                     .image = fine,
                     .in = in};
    for (int i = 0; i < l->n; i++) {
        struct level *v = &l->at[i];
        int32_t layers = v->S->grid.n[2];
        t.v = v;
        t.shift = i + 1;
        pvx_pool_run(l->pool, (size_t)layers, levels_mark_layer, &t);
        for (int32_t k = 0; k < layers; k++)
            v->first[k + 1] += v->first[k];
        pvx_pool_run(l->pool, (size_t)layers, number_layer, &t);
        rec_subsys_restrict(v->sub, r, v->col, v->first[layers], fine->present);
        pvx_pool_run(l->pool, rec_row_pieces(v->sub), average_chunk, &t);
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

/* Children of the coarse columns of layer k.  The four fine rows of voxels under a coarse row are walked along with
 * it. */
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
                    in[o] = rec_ld(t->coarse, (size_t)m[x], cs);
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
    t->v->sub->cs == 4 ? refine(t, (int32_t)k, 4) : refine(t, (int32_t)k, 1);
}

/* x of `next` from the solution of level i. */
static void levels_refine(const rec_levels *l, int i, const struct rec_descent *d,
                          const struct rec_subsys *next, float *x)
{
    const struct level *v = &l->at[i];
    const struct rec_card_ops *card = rec_card_of(next);
    struct walk t = {.v = v,
                     .fine = &next->S->grid,
                     .col = next->col,
                     .n = next->n,
                     .coarse = d->x[i % 2],
                     .x = x};
    if (card != NULL)
        card->refine(v->sub, d->x[i % 2] + l->cs, next, x);
    else
        pvx_pool_run(l->pool, (size_t)v->S->grid.n[2], refine_layer, &t);
}

void rec_levels_solve(const rec_problem *fine, struct rec_descent *d, float *x)
{
    const rec_levels *l = d->levels;
    size_t cs = (size_t)l->cs;
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report report;
    p.tolerance = TOLERANCE;
    p.deadline_ns = d->deadline_ns;
    d->iterations = 0;
    d->problem->selfcal = fine->selfcal;
    for (int i = l->n - 1; i >= 0; i--) {
        const struct level *v = &l->at[i];
        const struct rec_pictures in = {
            .b = v->b, .w = v->w, .per_channel = l->per_channel, .sigma = {-1, -1, -1, -1}};
        const struct rec_subsys *next = i > 0 ? l->at[i - 1].sub : fine->a;
        float *vx = d->x[i % 2] + cs;
        rec_problem_load(d->problem, v->sub, &in);
        rec_problem_weigh_as(d->problem, fine, (double)((uint64_t)1 << 3 * (i + 1)));
        d->problem->renewals = RENEWALS;
        if (i == l->n - 1)
            rec_start_zero(d->problem, vx);
        else
            d->problem->start = REC_START_FITS;
        p.iterations = i < l->n - 1 || i == 0 ? ITERATIONS : AT_FIRST;
        if (rec_solve(d->problem, &p, vx, &report) != PVX_OK) /* the default solver exists */
            rec_start_zero(d->problem, vx);
        d->iterations += report.iterations;
        memcpy(d->misfit2, report.misfit2, sizeof report.misfit2);
        levels_refine(l, i, d, next, i > 0 ? d->x[(i - 1) % 2] + cs : x);
    }
}

bool rec_levels_start(rec_problem *pb, struct rec_descent *d, float *x, float *spare)
{
    float *coarse = spare != NULL ? spare : x;
    double rwr[4], earlier;
    rec_levels_solve(pb, d, coarse);
    rec_selfcal_apply(pb);
    rec_problem_misfit(pb, d->misfit2);
    if (spare != NULL) {
        rec_start_scaled(pb, x);
        earlier = rec_lanes_total(pb->start_rwr);
        rec_residual(pb, spare, pb->yv[0], pb->yv[1], rwr);
    }
    pb->start = REC_START_FITS;
    if (spare != NULL && earlier <= rec_lanes_total(rwr))
        return true;
    if (spare != NULL)
        rec_copy_x(pb, x, spare);
    return false;
}
