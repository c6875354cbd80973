#include "recon/solve/temporal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/solve/impl.h"

#define WHITE   1.0 /* nu of (1b) in pcg.c */
#define KEPT    0.9 /* share of the previous volume: with all of it, unseen errors add up */
#define LIGHTER 0.5 /* factor on lambda at full trust */

struct rec_temporal {
    struct rec_grid grid;
    size_t bytes;
    int cs;
    rec_flow *flow;
    float *dense;  /* [voxels][cs] the volume before; 0 between two calls */
    float *expect; /* [voxels][cs] of the active columns */
    const int32_t *col;
    int32_t n;
};

pvx_err rec_temporal_new(const struct rec_grid *g, int cs, rec_temporal **out)
{
    rec_temporal *t = *out = pvx_calloc(1, sizeof *t);
    if (t == NULL)
        return PVX_ENOMEM;
    t->grid = *g;
    t->cs = cs;
    t->bytes = rec_grid_count(g) * (size_t)cs * sizeof(float);
    t->dense = pvx_reserve(t->bytes);
    t->expect = pvx_reserve(t->bytes);
    if (t->dense != NULL && t->expect != NULL && rec_flow_new(g, &t->flow) == PVX_OK)
        return PVX_OK;
    rec_temporal_free(out);
    return PVX_ENOMEM;
}

void rec_temporal_free(rec_temporal **t)
{
    if (*t == NULL)
        return;
    rec_flow_free(&(*t)->flow);
    pvx_unreserve((*t)->dense, (*t)->bytes);
    pvx_unreserve((*t)->expect, (*t)->bytes);
    PVX_FREE(*t);
}

/* ---- (1) ----------------------------------------------------------------------------------------*/

/* Catmull and Rom's weights of the four voxels around x along an axis of n; 0 beyond the grid. */
struct taps {
    int32_t i[4];
    float w[4];
};
static struct taps taps(float x, int32_t n)
{
    struct taps s = {{0}, {0}};
    if (!(x > -2 && x < (float)(n + 1)))
        return s;
    int32_t i = (int32_t)floorf(x);
    float t = x - (float)i;
    const float w[4] = {t * (-0.5f + t * (1 - 0.5f * t)), 1 + t * t * (-2.5f + 1.5f * t),
                        t * (0.5f + t * (2 - 1.5f * t)), t * t * (-0.5f + 0.5f * t)};
    for (int c = 0; c < 4; c++) {
        bool in = i - 1 + c >= 0 && i - 1 + c < n;
        s.i[c] = in ? i - 1 + c : 0;
        s.w[c] = in ? w[c] : 0;
    }
    return s;
}

REC_INLINE rec_f4 moved(const rec_temporal *t, const struct taps s[3], size_t cs)
{
    rec_f4 sum = {0};
    for (int z = 0; z < 4; z++)
        for (int y = 0; y < 4; y++) {
            const size_t row = (size_t)rec_grid_index(&t->grid, 0, s[1].i[y], s[2].i[z]);
            rec_f4 line = {0};
            for (int x = 0; x < 4; x++)
                line += rec_splat(s[0].w[x]) * rec_ld(t->dense, row + (size_t)s[0].i[x], cs);
            sum += rec_splat(s[1].w[y] * s[2].w[z]) * line;
        }
    return rec_select(sum > 0, sum, (rec_f4){0});
}
REC_INLINE void move(const rec_temporal *t, int32_t q0, int32_t q1, size_t cs)
{
    for (int32_t q = q0; q < q1; q++) {
        int32_t ijk[3];
        float u[3];
        struct taps s[3];
        rec_grid_ijk(&t->grid, t->col[q], ijk);
        rec_flow_at(t->flow, ijk, u);
        for (int a = 0; a < 3; a++)
            s[a] = taps((float)ijk[a] - u[a], t->grid.n[a]);
        rec_st(t->expect, (size_t)q, cs, moved(t, s, cs));
    }
}
static void move_chunk(void *ctx, size_t k)
{
    const rec_temporal *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->n, k, &q0, &q1);
    t->cs == 4 ? move(t, q0, q1, 4) : move(t, q0, q1, 1);
}

/* ---- (2) ----------------------------------------------------------------------------------------*/

/* 0 at `none`, 1 at `all`, linear between, constant beyond; 0 for NaN. */
static double temporal_ramp(double x, double none, double all)
{
    double r = (x - none) / (all - none);
    return r >= 1 ? 1 : r > 0 ? r : 0;
}

static double temporal_judge(const rec_temporal *t, rec_problem *pb, const float *x)
{
    double p[4], s[4], least = 1;
    memset(pb->nu, 0, sizeof pb->nu);
    memset(pb->keep, 0, sizeof pb->keep);
    for (int l = 0; l < pb->nch; l++)
        if (!(pb->in.sigma[l] > 0))
            return 0;
    rec_residual(pb, t->expect, pb->yv[0], pb->yv[1], p);
    rec_residual(pb, x, pb->yv[0], pb->yv[1], s);
    for (int l = 0; l < pb->nch; l++) {
        double rows = rec_rows_of(pb, l);
        double noise = rows * (pb->in.sigma[l] * pb->in.sigma[l] + pb->shot2[l]);
        double trust = p[l] > 0 && s[l] > 0 ? temporal_ramp(noise / p[l], 0.3, 0.6) *
                                                  temporal_ramp(p[l] / s[l], 1.3, 1.15)
                                            : 0;
        least = trust < least ? trust : least;
    }
    for (int l = 0; l < pb->nch; l++) {
        double by = 1 - (1 - LIGHTER) * least;
        pb->keep[l] = KEPT * least;
        pb->nu[l] = WHITE * least;
        pb->lambda[l] *= by;
        pb->formula[l] *= by;
    }
    return least;
}

double rec_temporal_expect(rec_temporal *t, rec_problem *pb, const struct rec_flow_volume *previous,
                           const float *x)
{
    const struct rec_subsys *a = pb->a;
    size_t bytes = (size_t)t->cs * sizeof(float);
    const struct rec_flow_volume now = {a->n, a->col, x, t->cs, pb->nch};
    t->col = a->col;
    t->n = a->n;
    rec_flow_find(t->flow, previous, &now, a->pool);
    for (int32_t q = 0; q < previous->n; q++)
        memcpy(t->dense + (size_t)previous->index[q] * (size_t)t->cs,
               previous->value + (size_t)q * (size_t)t->cs, bytes);
    pvx_pool_run(a->pool, rec_column_chunks(pb), move_chunk, t);
    for (int32_t q = 0; q < previous->n; q++)
        memset(t->dense + (size_t)previous->index[q] * (size_t)t->cs, 0, bytes);
    double trust = temporal_judge(t, pb, x);
    if (trust == 0)
        return 0;
    pb->expect = t->expect;
    return trust;
}
