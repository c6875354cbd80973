/* The code of pcg_pass.h; the including file names the table, PASSES. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "recon/solve/passes/pcg_pass.h"

static void begin_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->pb->a->cs, bytes = (size_t)(q1 - q0) * cs * sizeof *t->d;
    memset(t->d + (size_t)q0 * cs, 0, bytes);
    memset(t->phi + (size_t)q0 * cs, 0, bytes);
    rec_smooth_near(&t->smooth, t->pb->a, q0, q1);
}

/* span(t, first, end, cs, sums) over chunk k of the columns, of one channel four voxels at a time; the
 * first sums to partial results `slot`. */
#define OVER_COLUMNS(t, k, slot, span, sums)                                                  \
    do {                                                                                      \
        int32_t q0_, q1_;                                                                     \
        rec_d4 sum_[4] = {0}, quads_[4] = {0};                                                \
        rec_chunk_range((t)->pb->a->n, k, &q0_, &q1_);                                        \
        size_t first_ = (size_t)q0_, end_ = (size_t)q1_, whole_ = end_ - (end_ - first_) % 4; \
        if ((t)->pb->a->cs == 4) {                                                            \
            span(t, first_, end_, 4, sum_);                                                   \
        } else {                                                                              \
            span(t, first_, whole_, REC_QUAD, quads_);                                        \
            span(t, whole_, end_, 1, sum_);                                                   \
        }                                                                                     \
        for (int w_ = 0; w_ < (sums); w_++)                                                   \
            rec_put_both((t)->pb->part[slot][w_], &sum_[w_], &quads_[w_]);                    \
    } while (0)
/* NOLINTNEXTLINE(bugprone-macro-parentheses): i is declared here */
#define FOR_ELEMENTS(i, i0, i1, cs) for (size_t i = i0; i < (i1); i += (cs) == REC_QUAD ? 4 : 1)

/* The same of four voxels as of one. */
REC_INLINE rec_f4 smooth_at(const struct rec_pcg *t, const float *v, size_t i, size_t cs)
{
    int32_t q = (int32_t)i;
    if (cs != REC_QUAD)
        return rec_smooth_at(&t->smooth, v, q, cs);
    return (rec_f4){
        rec_smooth_at(&t->smooth, v, q, 1)[0], rec_smooth_at(&t->smooth, v, q + 1, 1)[0],
        rec_smooth_at(&t->smooth, v, q + 2, 1)[0], rec_smooth_at(&t->smooth, v, q + 3, 1)[0]};
}
REC_INLINE rec_f4 stiff_by(const struct rec_pcg *t, size_t i, size_t cs)
{
    const struct rec_stiff *s = t->stiff + i;
    return cs == REC_QUAD ? (rec_f4){s[0].by, s[1].by, s[2].by, s[3].by} : rec_splat(s->by);
}
REC_INLINE rec_f4 stiff_inverse(const struct rec_pcg *t, size_t i, size_t cs)
{
    const struct rec_stiff *s = t->stiff + i;
    return cs == REC_QUAD ? (rec_f4){s[0].inverse, s[1].inverse, s[2].inverse, s[3].inverse}
                          : rec_splat(s->inverse);
}

/* M at column i. */
REC_INLINE rec_f4 inverse_diagonal(const struct rec_pcg *t, size_t i, size_t cs)
{
    const struct rec_near *near = t->smooth.near + i;
    const float *d = t->smooth.diag2;
    rec_f4 ll = cs == REC_QUAD
                    ? (rec_f4){d[near[0].have], d[near[1].have], d[near[2].have], d[near[3].have]}
                    : rec_splat(d[near->have]);
    rec_f4 h = rec_of_lanes(t->pb->share, cs) * rec_of_each(t->pb->diag, i, cs) +
               rec_of_lanes(t->lambda, cs) * (stiff_by(t, i, cs) * ll);
    return rec_select(h > 0, rec_splat(1) / h, (rec_f4){0});
}

/* d of (4), and d'phi. */
REC_INLINE void direction(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    rec_f4 beta = rec_of_lanes(t->beta, cs), mu = rec_of_lanes(t->mu, cs), zero = {0};
    FOR_ELEMENTS (i, i0, i1, cs) {
        rec_f4 phi = rec_ld(t->phi, i, cs), x = rec_ld(t->x, i, cs);
        rec_f4 d = beta * rec_ld(t->d, i, cs) - mu * inverse_diagonal(t, i, cs) * phi;
        d = rec_select((x > 0) | (phi < 0), d, zero);
        rec_st(t->d, i, cs, d);
        rec_add_product(&sum[S_A], d, phi);
    }
}
static void direction_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, direction, 1);
}

/* d'L V L d;  lx = V L x. */
REC_INLINE void of_direction(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    FOR_ELEMENTS (i, i0, i1, cs) {
        rec_f4 lap = smooth_at(t, t->d, i, cs);
        rec_add_product(&sum[S_A], lap, stiff_by(t, i, cs) * lap);
    }
}
REC_INLINE void of_iterate(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    (void)sum;
    FOR_ELEMENTS (i, i0, i1, cs)
        rec_st(t->lx, i, cs, stiff_by(t, i, cs) * smooth_at(t, t->x, i, cs));
}
static void lx_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, of_iterate, 0);
}

/* What d'Hd is made of.  Rows: q = A d, q'Wq.  Columns: d'L V L d. */
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
        OVER_COLUMNS(t, i - rows, i, of_direction, 1);
}

/* (5): next; the columns that were clipped. */
REC_INLINE void step(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, int32_t *n,
                     int32_t *clipped, rec_d4 *sum)
{
    rec_f4 alpha = rec_of_lanes(t->alpha, cs), zero = {0};
    FOR_ELEMENTS (i, i0, i1, cs) {
        rec_f4 x = rec_ld(t->x, i, cs), y = x + alpha * rec_ld(t->d, i, cs);
        rec_i4 keep = y >= 0;
        y = rec_select(keep, y, zero);
        rec_st(t->next, i, cs, y);
        rec_add_product(sum, y - x, y - x);
        for (int32_t v = 0; v < (cs == REC_QUAD ? 4 : 1); v++) {
            clipped[*n] = (int32_t)i + v;
            *n += cs == REC_QUAD ? !keep[v] : !rec_all(keep);
        }
    }
}
static void step_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    int32_t q0, q1, n = 0;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    int32_t *clipped = t->pb->clipped + q0;
#define SPAN(t, i0, i1, cs, sum) step(t, i0, i1, cs, &n, clipped, sum)
    OVER_COLUMNS(t, k, k, SPAN, 1);
#undef SPAN
    t->pb->n_clipped[k] = n;
}

/* e = s/alpha - d, not 0 but in the clipped columns: A e to the slab's image of A d. */
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

/* Rows: q = A d, where columns were clipped A (d + e), r += alpha q, r'Wr, q = W r.  Columns: lx. */
static void residual_task(void *ctx, size_t i)
{
    struct rec_pcg *t = ctx;
    size_t rows = rec_row_chunks(t->pb);
    double *out = t->pb->part[i][S_A];
    if (i >= rows) {
        lx_chunk(t, i - rows);
        return;
    }
    if (t->any_clipped)
        rec_take_product(t->pb, i, t->q);
    t->pb->in.per_channel ? rec_rows_step(t->pb, i, 4, true, t->alpha, t->r, t->q, t->q, out)
    : t->pb->cs == 4      ? rec_rows_step(t->pb, i, 4, false, t->alpha, t->r, t->q, t->q, out)
                          : rec_rows_step(t->pb, i, 1, false, t->alpha, t->r, t->q, t->q, out);
}

/* (2a): how much a flame curves goes with how bright it burns.  DARK keeps the dark parts from being
 * held more than about three times as firmly as the bright ones.  x - L x / 8 is the mean of x and its
 * neighbours, and lx has L x already. */
#define DARK 0.09F
REC_INLINE void brightness(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    rec_f4 one = rec_splat(1), zero = {0};
    FOR_ELEMENTS (i, i0, i1, cs) {
        rec_f4 x = rec_ld(t->x, i, cs), lap = stiff_inverse(t, i, cs) * rec_ld(t->lx, i, cs);
        rec_f4 y = x - rec_splat(0.125F) * lap;
        if (cs == 4)
            y = (rec_f4){(y[0] + y[1]) + (y[2] + y[3])};
        rec_st(t->lx, i, cs, lap);
        rec_st(t->next, i, cs == 4 ? 1 : cs, y);
        rec_add_product(&sum[S_A], y, one);
        rec_add_product(&sum[S_B], y, y);
        rec_add_product(&sum[S_C], rec_select(x > 0, one, zero), one);
    }
}
static void brightness_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, brightness, 3);
}
REC_INLINE void stiffness(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    bool bright = t->usual > 1 / (double)FLT_MAX; /* 1/usual is a float */
    float scale = bright ? (float)(1 / t->usual) : 0;
    (void)sum;
    FOR_ELEMENTS (i, i0, i1, cs) {
        for (size_t v = i; v < i + (cs == REC_QUAD ? 4 : 1); v++) {
            float inverse = bright ? sqrtf(DARK + scale * fmaxf(t->next[v], 0)) : 1;
            t->stiff[v] = (struct rec_stiff){1 / inverse, inverse};
        }
        rec_st(t->lx, i, cs, stiff_by(t, i, cs) * rec_ld(t->lx, i, cs));
    }
}
static void stiffness_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, stiffness, 0);
}

/* phi of (3) from ar = A'W r and lx.  Sums: phi'M phi, phi'M phi_old, x'L lx, ||x||^2. */
REC_INLINE void gradient(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    rec_f4 lambda = rec_of_lanes(t->lambda, cs), zero = {0};
    FOR_ELEMENTS (i, i0, i1, cs) {
        rec_f4 x = rec_ld(t->x, i, cs), lx = rec_ld(t->lx, i, cs);
        rec_f4 g = rec_ld(t->ar, i, cs) + lambda * smooth_at(t, t->lx, i, cs);
        g = rec_select((x > 0) | (g < 0), g, zero);
        rec_st(t->phi, i, cs, g);
        rec_f4 mg = inverse_diagonal(t, i, cs) * g;
        rec_add_product(&sum[S_A], mg, g);
        rec_add_product(&sum[S_B], mg, rec_ld(t->phi_old, i, cs));
        rec_add_product(&sum[S_C], lx, stiff_inverse(t, i, cs) * lx);
        rec_add_product(&sum[S_D], x, x);
    }
}
static void regradient_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, gradient, 4);
}
static void gradient_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    rec_adjoint_range(t->pb->a, t->q, q0, q1, t->ar);
    regradient_chunk(t, k);
}

/* phi's and s's of the step from x to next; x in place of next at `back` of the way. */
REC_INLINE void slope(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    FOR_ELEMENTS (i, i0, i1, cs)
        rec_add_product(&sum[S_A], rec_ld(t->next, i, cs) - rec_ld(t->x, i, cs),
                        rec_ld(t->phi, i, cs));
}
static void slope_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, slope, 1);
}
REC_INLINE void retreat(struct rec_pcg *t, size_t i0, size_t i1, size_t cs, rec_d4 sum[4])
{
    rec_f4 back = rec_of_lanes(t->back, cs), zero = {0};
    (void)sum;
    FOR_ELEMENTS (i, i0, i1, cs) {
        rec_f4 x = rec_ld(t->x, i, cs), y = x + back * (rec_ld(t->next, i, cs) - x);
        rec_st(t->next, i, cs, rec_select(y > 0, y, zero));
    }
}
static void retreat_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    OVER_COLUMNS(t, k, k, retreat, 0);
}

const struct rec_pcg_passes PASSES = {
    .begin = begin_chunk,
    .direction = direction_chunk,
    .curvature = curvature_task,
    .step = step_chunk,
    .clipped = clipped_slab,
    .residual = residual_task,
    .smoothness = lx_chunk,
    .brightness = brightness_chunk,
    .stiffness = stiffness_chunk,
    .gradient = gradient_chunk,
    .regradient = regradient_chunk,
    .slope = slope_chunk,
    .retreat = retreat_chunk,
};
