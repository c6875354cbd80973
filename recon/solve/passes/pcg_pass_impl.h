/* The code of pcg_pass.h; the including file names the function that fills the table, PASSES. */
#include <math.h>
#include <string.h>

#include "recon/solve/passes/pcg_pass.h"

/* The sums of a task. */
enum { S_A, S_B, S_C };

/* Inputs of a pass at its elements.  They are a copy, so that no store of the pass can change them. */
struct elements {
    struct rec_pcg v;
    rec_fw a, b;  /* coefficients of the pass */
    rec_fw share; /* pb->share */
    const float *diag;
    const float *lap; /* L of the vector that the pass asks for, */
    size_t from;      /* from here on */
    struct rec_sum sum[4];
    size_t half; /* the half of the sums with which the next floats begin */
    size_t chunk;
};
#define PIECE 256 /* columns per piece, for which L is computed at a time */

/* Calls at(&e, i, m, cs) over all floats of chunk k of the columns: m = REC_WIDE floats from i on, fewer at the end.
 * If the vector `of` is not NULL, e.lap holds L of it.  The first `sums` sums go to partial results `slot`. */
#define OVER(t, k, slot, cs, at, alpha, beta, of, sums)                             \
    do {                                                                            \
        struct elements e_ = {.v = *(t),                                            \
                              .a = rec_wide_lanes(alpha, cs),                       \
                              .b = rec_wide_lanes(beta, cs),                        \
                              .share = rec_wide_lanes((t)->pb->share, cs),          \
                              .diag = (t)->pb->diag};                               \
        const struct rec_run *run_;                                                 \
        const float *of_ = (of);                                                    \
        float lap_[PIECE * 4 + REC_SMOOTH_PAD];                                     \
        struct rec_span s_;                                                         \
        int32_t end_;                                                               \
        rec_chunk_range((t)->pb->a->n, k, &s_.q0, &end_);                           \
        run_ = (t)->smooth.run + s_.q0;                                             \
        e_.chunk = (k);                                                             \
        for (e_.lap = lap_; s_.q0 < end_; s_.q0 = s_.q1) {                          \
            s_.q1 = end_ - s_.q0 < PIECE ? end_ : s_.q0 + PIECE;                    \
            if (of_ != NULL)                                                        \
                rec_smooth_over(&e_.v.smooth, &run_, of_, cs, s_, lap_);            \
            size_t i_ = e_.from = (size_t)s_.q0 * (cs), to_ = (size_t)s_.q1 * (cs); \
            for (; i_ + 8 <= to_; i_ += 8)                                          \
                for (e_.half = 0; e_.half < 8 / REC_WIDE; e_.half++)                \
                    at(&e_, i_ + 4 * e_.half, REC_WIDE, cs);                        \
            for (e_.half = 0; i_ < to_; i_ += REC_WIDE, e_.half++)                  \
                at(&e_, i_, to_ - i_ < REC_WIDE ? to_ - i_ : REC_WIDE, cs);         \
        }                                                                           \
        for (int w_ = 0; w_ < (sums); w_++)                                         \
            rec_put_sum((t)->pb->part[slot][w_], &e_.sum[w_], cs);                  \
    } while (0)
#define OVER_COLUMNS(t, k, slot, at, alpha, beta, of, sums)         \
    do {                                                            \
        if ((t)->pb->a->cs == 4)                                    \
            OVER(t, k, slot, (size_t)4, at, alpha, beta, of, sums); \
        else                                                        \
            OVER(t, k, slot, (size_t)1, at, alpha, beta, of, sums); \
    } while (0)
static const double nothing[4];

static void begin_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->pb->a->cs, n = (size_t)(q1 - q0), bytes = n * cs * sizeof *t->d;
    memset(t->d + (size_t)q0 * cs, 0, bytes);
    rec_smooth_runs(&t->smooth, t->pb->a, q0, q1);
    memcpy(t->stiff.diag + q0, t->smooth.diag2 + q0, n * sizeof *t->stiff.diag);
    for (int32_t q = q0; q < q1; q++)
        t->stiff.by[q] = t->stiff.inverse[q] = 1;
}

/* b: lambda. */
REC_INLINE void scale(struct elements *e, size_t i, size_t m, size_t cs)
{
    rec_fw zero = {0}, h = e->share * rec_wide_each(e->diag, i, m, cs) +
                           e->b * rec_wide_each(e->v.stiff.diag, i, m, cs);
    if (e->v.expect != NULL)
        h += e->b * rec_wide_lanes(e->v.nu, cs);
    /* 1/V is the square root of y / y_usual + 0.09 */
    rec_fw s = rec_wide_root(rec_wide_root(rec_wide_each(e->v.stiff.inverse, i, m, cs)) / h);
    rec_put_wide(e->v.scale, i, m, rec_wide_select(h > 0, s, zero));
}
static void scale_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, scale, nothing, t->lambda, NULL, 0);
}

/* d of (4), and d'phi.  a: beta. */
REC_INLINE void direction(struct elements *e, size_t i, size_t m, size_t cs)
{
    const struct rec_pcg *t = &e->v;
    rec_fw phi = rec_wide(t->phi, i, m), x = rec_wide(t->x, i, m), zero = {0};
    rec_fw mu = rec_wide_lanes(t->mu, cs), s = rec_wide(t->scale, i, m), z = s * phi;
    rec_fw d = e->a * rec_wide(t->d, i, m) - mu * s * z;
    d = rec_wide_select((x > 0) | (phi < 0), d, zero);
    rec_put_wide(t->d, i, m, d);
    rec_wide_add(&e->sum[S_A], e->half, d, phi);
}
static void direction_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, direction, t->beta, t->lambda, NULL, 1);
}

/* lx = V L x, and its part of f. */
REC_INLINE void put_lx(struct elements *e, size_t i, size_t m, size_t cs, rec_fw lap)
{
    const struct rec_pcg *t = &e->v;
    rec_fw lx = rec_wide_each(t->stiff.by, i, m, cs) * lap;
    rec_put_wide(t->lx, i, m, lx);
    rec_wide_add(&e->sum[S_A], e->half, lx, rec_wide_each(t->stiff.inverse, i, m, cs) * lx);
    if (t->expect != NULL) {
        rec_fw off = rec_wide(t->x, i, m) - rec_wide(t->expect, i, m);
        rec_wide_add(&e->sum[S_A], e->half, rec_wide_lanes(t->nu, cs) * off, off);
    }
}
/* d'L V L d;  lx = V L x. */
REC_INLINE void of_direction(struct elements *e, size_t i, size_t m, size_t cs)
{
    rec_fw lap = rec_wide(e->lap, i - e->from, m);
    rec_wide_add(&e->sum[S_A], e->half, lap, rec_wide_each(e->v.stiff.by, i, m, cs) * lap);
    if (e->v.expect != NULL) {
        rec_fw d = rec_wide(e->v.d, i, m);
        rec_wide_add(&e->sum[S_A], e->half, rec_wide_lanes(e->v.nu, cs) * d, d);
    }
}
/* Sums: x'L lx, ||x||^2. */
REC_INLINE void of_iterate(struct elements *e, size_t i, size_t m, size_t cs)
{
    const struct rec_pcg *t = &e->v;
    rec_fw x = rec_wide(t->x, i, m), lap = rec_wide(e->lap, i - e->from, m);
    if (t->expect != NULL)
        lap -= rec_wide(t->lhat, i, m);
    put_lx(e, i, m, cs, lap);
    rec_wide_add(&e->sum[S_B], e->half, x, x);
}
REC_INLINE void of_expect(struct elements *e, size_t i, size_t m, size_t cs)
{
    (void)cs;
    rec_put_wide(e->v.lhat, i, m, e->a * rec_wide(e->lap, i - e->from, m));
}
static void expected_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, of_expect, t->pb->keep, nothing, t->expect, 0);
}
static void lx_to(struct rec_pcg *t, size_t k, size_t slot)
{
    OVER_COLUMNS(t, k, slot, of_iterate, nothing, nothing, t->x, 2);
}
static void lx_chunk(void *ctx, size_t k)
{
    lx_to(ctx, k, k);
}

/* The parts of d'Hd.  Rows: q = A d, q'Wq.  Columns: d'L V L d. */
static void curvature_task(void *ctx, size_t i)
{
    struct rec_pcg *t = ctx;
    size_t rows = rec_row_chunks(t->pb);
    double *out = t->pb->part[i][S_A];
    if (i < rows)
        t->pb->in.per_channel ? rec_rows_product(t->pb, i, 4, true, t->q, out)
        : t->pb->cs == 4      ? rec_rows_product(t->pb, i, 4, false, t->q, out)
                              : rec_rows_product(t->pb, i, 1, false, t->q, out);
    else
        OVER_COLUMNS(t, i - rows, i, of_direction, nothing, nothing, t->d, 1);
}

/* (5): next; the columns that were clipped.  a: alpha. */
REC_INLINE void step(struct elements *e, size_t i, size_t m, size_t cs)
{
    const struct rec_pcg *t = &e->v;
    rec_fw x = rec_wide(t->x, i, m), y = x + e->a * rec_wide(t->d, i, m), zero = {0};
    rec_iw keep = y >= 0;
    y = rec_wide_select(keep, y, zero);
    rec_put_wide(t->next, i, m, y);
    rec_wide_add(&e->sum[S_A], e->half, y - x, y - x);
    if (rec_wide_all(keep))
        return;
    int32_t *n = &t->pb->n_clipped[e->chunk], q0, q1;
    rec_chunk_range(t->pb->a->n, e->chunk, &q0, &q1);
    for (size_t v = 0; v < m / cs; v++) {
        bool all = cs == 4 ? rec_all_of(keep, v) : keep[v] != 0;
        if (!all)
            t->pb->clipped[q0 + (*n)++] = (int32_t)(i / cs + v);
    }
}
static void step_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    t->pb->n_clipped[k] = 0;
    OVER_COLUMNS(t, k, k, step, t->alpha, nothing, NULL, 1);
}

/* e = s/alpha - d, which is 0 except in clipped columns; adds A e to the slab's image. */
REC_INLINE void clipped(struct rec_pcg *t, size_t slab, size_t cs)
{
    const rec_problem *pb = t->pb;
    rec_f4 alpha = rec_coef(t->alpha), inverse = {0};
    int32_t q0, q1, end, i;
    rec_slab_range(pb->a, slab, &q0, &q1);
    for (int l = 0; l < 4; l++)
        inverse[l] = t->alpha[l] > 0 ? (float)(1 / t->alpha[l]) : 0;
    for (size_t k = (size_t)(q0 / rec_chunk(pb->a->n)); k < rec_column_chunks(pb); k++) {
        rec_chunk_range(pb->a->n, k, &i, &end);
        for (end = i + pb->n_clipped[k]; i < end; i++) {
            int32_t c = pb->clipped[i];
            rec_f4 x = rec_ld(t->x, (size_t)c, cs), d = rec_ld(t->d, (size_t)c, cs);
            if (c >= q1)
                return;
            if (c >= q0)
                rec_add_column(pb->a, &pb->images, slab, c,
                               rec_select(x + alpha * d < 0, -x * inverse - d, (rec_f4){0}));
        }
    }
}
static void clipped_slab(void *ctx, size_t slab)
{
    struct rec_pcg *t = ctx;
    t->pb->a->cs == 4 ? clipped(t, slab, 4) : clipped(t, slab, 1);
}

/* Rows: q = A d, plus A e if columns were clipped; r += alpha q, r'Wr, q = W r.  Columns: lx. */
static void residual_task(void *ctx, size_t i)
{
    struct rec_pcg *t = ctx;
    size_t rows = rec_row_chunks(t->pb);
    double *out = t->pb->part[i][S_A];
    if (i >= rows) {
        lx_to(t, i - rows, i);
        return;
    }
    if (t->any_clipped)
        rec_collect_blocks(t->pb->a, &t->pb->images, rec_blocks_of(t->pb->a, i), t->q, true);
    t->pb->in.per_channel ? rec_rows_step(t->pb, i, 4, true, t->alpha, t->r, t->q, t->q, out)
    : t->pb->cs == 4      ? rec_rows_step(t->pb, i, 4, false, t->alpha, t->r, t->q, t->q, out)
                          : rec_rows_step(t->pb, i, 1, false, t->alpha, t->r, t->q, t->q, out);
}

/* (2a): the curvature of a flame grows with its brightness.  x - L x / 8 is the mean of x and its neighbours; lx already
 * holds L x. */
REC_INLINE void brightness(struct elements *e, size_t i, size_t m, size_t cs)
{
    const struct rec_pcg *t = &e->v;
    rec_fw x = rec_wide(t->x, i, m), one = rec_wide_splat(1), zero = {0};
    rec_fw lap = rec_wide_each(t->stiff.inverse, i, m, cs) * rec_wide(t->lx, i, m);
    rec_fw whole = lap;
    if (e->v.expect != NULL)
        whole += rec_wide(e->v.lhat, i, m);
    rec_fw y = x - rec_wide_splat(0.125F) * whole;
    rec_put_wide(t->lx, i, m, lap);
    if (cs == 4) { /* the sum of a column goes into its lane 0 */
        rec_f4 u = rec_four(y, 0), v = rec_four(y, REC_WIDE / 4 - 1);
        u = (rec_f4){(u[0] + u[1]) + (u[2] + u[3])};
        v = (rec_f4){(v[0] + v[1]) + (v[2] + v[3])};
        y = rec_pair(u, v);
        t->next[i / 4] = u[0];
        if (m == 8)
            t->next[i / 4 + 1] = v[0];
    } else {
        rec_put_wide(t->next, i, m, y);
    }
    rec_wide_add(&e->sum[S_A], e->half, y, one);
    rec_wide_add(&e->sum[S_B], e->half, y, y);
    rec_wide_add(&e->sum[S_C], e->half, rec_wide_select(x > 0, one, zero), one);
}
static void brightness_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, brightness, nothing, nothing, NULL, 3);
}
REC_INLINE void stiffen(struct elements *e, size_t i, size_t m, size_t cs)
{
    put_lx(e, i, m, cs, rec_wide(e->v.lx, i, m));
}
static void stiffness_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    const struct rec_pcg_bright bright = rec_pcg_bright(t);
    const float *y = t->next, *diag2 = t->smooth.diag2;
    float *restrict by = t->stiff.by, *restrict inverse = t->stiff.inverse;
    float *restrict diag = t->stiff.diag;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        inverse[q] = sqrtf(bright.dark + bright.scale * (y[q] > 0 ? y[q] : 0));
        by[q] = 1 / inverse[q];
        diag[q] = by[q] * diag2[q];
    }
    OVER_COLUMNS(t, k, k, stiffen, nothing, nothing, NULL, 1);
}

/* phi of (3) from ar = A'W r and lx.  Sums: phi'M phi, phi'M phi_old. */
REC_INLINE void gradient(struct elements *e, size_t i, size_t m, size_t cs)
{
    const struct rec_pcg *t = &e->v;
    rec_fw x = rec_wide(t->x, i, m), zero = {0};
    rec_fw g = rec_wide(t->ar, i, m) + e->b * rec_wide(e->lap, i - e->from, m);
    if (t->expect != NULL)
        g += e->b * rec_wide_lanes(t->nu, cs) * (x - rec_wide(t->expect, i, m));
    g = rec_wide_select((x > 0) | (g < 0), g, zero);
    rec_put_wide(t->phi, i, m, g);
    rec_fw s = rec_wide(t->scale, i, m), sg = s * g;
    rec_wide_add(&e->sum[S_A], e->half, sg, sg);
    rec_wide_add(&e->sum[S_B], e->half, s * sg, rec_wide(t->phi_old, i, m));
}
static void regradient_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, gradient, nothing, t->lambda, t->lx, 2);
}
static void gradient_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    rec_adjoint_range(t->pb->a, t->q, q0, q1, t->ar);
    regradient_chunk(t, k);
}

/* slope: phi's of the step s from x to next.  retreat: moves next to the share `back` (a) of the way from x. */
REC_INLINE void slope(struct elements *e, size_t i, size_t m, size_t cs)
{
    const struct rec_pcg *t = &e->v;
    (void)cs;
    rec_wide_add(&e->sum[S_A], e->half, rec_wide(t->next, i, m) - rec_wide(t->x, i, m),
                 rec_wide(t->phi, i, m));
}
static void slope_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, slope, nothing, nothing, NULL, 1);
}
REC_INLINE void retreat(struct elements *e, size_t i, size_t m, size_t cs)
{
    const struct rec_pcg *t = &e->v;
    rec_fw x = rec_wide(t->x, i, m), y = x + e->a * (rec_wide(t->next, i, m) - x), zero = {0};
    (void)cs;
    rec_put_wide(t->next, i, m, rec_wide_select(y > 0, y, zero));
}
static void retreat_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, retreat, t->back, nothing, NULL, 0);
}

void PASSES(struct rec_pcg_passes *p)
{
    *p = (struct rec_pcg_passes){{
        [REC_PASS_EXPECTED] = expected_chunk,
        [REC_PASS_BEGIN] = begin_chunk,
        [REC_PASS_SCALE] = scale_chunk,
        [REC_PASS_DIRECTION] = direction_chunk,
        [REC_PASS_CURVATURE] = curvature_task,
        [REC_PASS_STEP] = step_chunk,
        [REC_PASS_CLIPPED] = clipped_slab,
        [REC_PASS_RESIDUAL] = residual_task,
        [REC_PASS_SMOOTHNESS] = lx_chunk,
        [REC_PASS_BRIGHTNESS] = brightness_chunk,
        [REC_PASS_STIFFNESS] = stiffness_chunk,
        [REC_PASS_GRADIENT] = gradient_chunk,
        [REC_PASS_REGRADIENT] = regradient_chunk,
        [REC_PASS_SLOPE] = slope_chunk,
        [REC_PASS_RETREAT] = retreat_chunk,
    }};
}
