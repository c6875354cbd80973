#include "recon/frame/spread.h"

#include <math.h>
#include <string.h>

#define MEAN 0.3F /* share of <V> in sd^2 */

struct spread_pass {
    struct rec_spread *s;
    const float *from;
    float *to;
    size_t cs;
    int axis;
    float *modes, *sd;
    uint32_t count;
};

static void spread_run(const struct spread_pass *t, pvx_task_fn fn)
{
    const struct rec_subsys *a = t->s->a;
    pvx_pool_run(a->pool, rec_chunks(a->n), fn, (void *)(uintptr_t)t);
}

/* Column of the neighbour of voxel v at -1 or +1 along the axis; -1: none. */
static int32_t spread_next(const struct spread_pass *t, int32_t v, int32_t by)
{
    const struct rec_grid *g = &t->s->a->S->grid;
    const int32_t step[3] = {1, g->n[0], g->n[0] * g->n[1]};
    int32_t at = v / step[t->axis] % g->n[t->axis] + by;
    return at >= 0 && at < g->n[t->axis] ? t->s->place[v + by * step[t->axis]] - 1 : -1;
}

/* to = from and its two neighbours along the axis, added up. */
static void spread_along(void *ctx, size_t k)
{
    const struct spread_pass *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->s->a->n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        float *to = t->to + (size_t)q * t->cs;
        memcpy(to, t->from + (size_t)q * t->cs, t->cs * sizeof *to);
        for (int32_t by = -1; by <= 1; by += 2) {
            int32_t p = spread_next(t, t->s->a->col[q], by);
            for (size_t l = 0; l < t->cs && p >= 0; l++)
                to[l] += t->from[(size_t)p * t->cs + l];
        }
    }
}

/* Sums of v over q and its 26 neighbours, in work[0]. */
static void spread_sums(struct rec_spread *s, const float *v, size_t cs)
{
    const float *from = v;
    for (int axis = 0; axis < 3; axis++) {
        struct spread_pass t = {
            .s = s, .from = from, .to = s->work[axis % 2], .cs = cs, .axis = axis};
        spread_run(&t, spread_along);
        from = t.to;
    }
}

static void spread_divide(void *ctx, size_t k)
{
    const struct spread_pass *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->s->a->n, k, &q0, &q1);
    for (size_t i = (size_t)q0 * t->cs; i < (size_t)q1 * t->cs; i++)
        t->to[i] = t->from[i] * t->s->inverse[i / t->cs];
}

void rec_spread_begin(struct rec_spread *s, const struct rec_subsys *a)
{
    s->a = a;
    for (int32_t q = 0; q < a->n; q++) {
        s->place[a->col[q]] = q + 1;
        s->inverse[q] = 1;
    }
    spread_sums(s, s->inverse, 1);
    for (int32_t q = 0; q < a->n; q++)
        s->inverse[q] = 1 / s->work[0][q];
}

void rec_spread_end(struct rec_spread *s)
{
    for (int32_t q = 0; q < s->a->n; q++)
        s->place[s->a->col[q]] = 0;
}

void rec_spread_mean(struct rec_spread *s, const float *v, float *out)
{
    size_t cs = (size_t)s->a->cs;
    struct spread_pass t = {.s = s, .from = s->work[0], .to = out, .cs = cs};
    spread_sums(s, v, cs);
    spread_run(&t, spread_divide);
}

/* sd = V. */
static void spread_square(void *ctx, size_t k)
{
    const struct spread_pass *t = ctx;
    size_t vector = (size_t)t->s->a->n * t->cs;
    int32_t q0, q1;
    rec_chunk_range(t->s->a->n, k, &q0, &q1);
    memset(t->sd + (size_t)q0 * t->cs, 0, (size_t)(q1 - q0) * t->cs * sizeof *t->sd);
    for (uint32_t m = 0; m < t->count; m++) {
        const float *d = t->modes + m * vector;
        for (size_t i = (size_t)q0 * t->cs; i < (size_t)q1 * t->cs; i++)
            t->sd[i] += d[i] * d[i];
    }
}

/* (2) from V in sd and <V>, not yet divided, in work[0]; the shrinking goes to work[1]. */
static void spread_settle(void *ctx, size_t k)
{
    const struct spread_pass *t = ctx;
    const struct rec_spread *s = t->s;
    size_t vector = (size_t)s->a->n * t->cs;
    int32_t q0, q1;
    rec_chunk_range(s->a->n, k, &q0, &q1);
    for (size_t i = (size_t)q0 * t->cs; i < (size_t)q1 * t->cs; i++) {
        float v = t->sd[i];
        float both = MEAN * s->work[0][i] * s->inverse[i / t->cs] + (1 - MEAN) * v;
        s->work[1][i] = v > both ? sqrtf(both / v) : 1;
        t->sd[i] = sqrtf(both);
    }
    for (uint32_t m = 0; m < t->count; m++) {
        float *d = t->modes + m * vector;
        for (size_t i = (size_t)q0 * t->cs; i < (size_t)q1 * t->cs; i++)
            d[i] *= s->work[1][i];
    }
}

void rec_spread_deviations(struct rec_spread *s, float *modes, uint32_t count, float *sd)
{
    struct spread_pass t = {
        .s = s, .cs = (size_t)s->a->cs, .modes = modes, .sd = sd, .count = count};
    spread_run(&t, spread_square);
    spread_sums(s, sd, t.cs);
    spread_run(&t, spread_settle);
}
