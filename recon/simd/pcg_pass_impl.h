/* The code of pcg_pass.h; the including file names the table, PASSES. */
#include "recon/solve/passes/pcg_pass.h"

#define FOR_LANES(t, fn, ...) \
    ((t)->j->a->cs == 4 ? fn(__VA_ARGS__, (size_t)4) : fn(__VA_ARGS__, (size_t)1))

static void near_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_smooth_near(&t->smooth, t->j->a, q0, q1);
}

/* M at column i. */
REC_INLINE rec_f4 inverse_diagonal(const struct rec_pcg *t, size_t i, rec_f4 lambda)
{
    float smooth = t->stiff[i].by * t->smooth.diag2[t->smooth.near[i].have];
    rec_f4 h = rec_coef(t->j->share) * rec_splat(t->j->diag[i]) + lambda * rec_splat(smooth);
    return rec_select(h > 0, rec_splat(1) / h, (rec_f4){0});
}

/* d of (4), and d'phi. */
REC_INLINE void direction(struct rec_pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 beta = rec_coef(t->beta), mu = rec_coef(t->mu), lambda = rec_coef(t->lambda), zero = {0};
    rec_d4 sum = {0};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 phi = rec_ld(t->phi, i, cs), x = rec_ld(t->x, i, cs);
        rec_f4 d = beta * rec_ld(t->d, i, cs) - mu * inverse_diagonal(t, i, lambda) * phi;
        d = rec_select((x > 0) | (phi < 0), d, zero);
        rec_st(t->d, i, cs, d);
        rec_add_product(&sum, d, phi);
    }
    rec_put(t->j->s->part[k][S_A], &sum);
}
static void direction_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    FOR_LANES(t, direction, t, k);
}

/* ld = V L d on one chunk of columns and d'L V L d; or lx = V L x. */
REC_INLINE void second_differences(struct rec_pcg *t, const float *v, float *lv, size_t k,
                                   double out[4], size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_d4 sum = {0};
    for (int32_t i = q0; i < q1; i++) {
        rec_f4 lap = rec_smooth_at(&t->smooth, v, i, cs), stiff = rec_splat(t->stiff[i].by) * lap;
        rec_st(lv, (size_t)i, cs, stiff);
        rec_add_product(&sum, lap, stiff);
    }
    rec_put(out, &sum);
}

/* What d'Hd is made of.  Rows: q = A d, q'Wq.  Columns: ld = V L d, d'L ld. */
static void curvature_task(void *ctx, size_t i)
{
    struct rec_pcg *t = ctx;
    size_t rows = rec_job_row_chunks(t->j);
    double *out = t->j->s->part[i][S_A];
    if (i < rows)
        t->j->w4 != NULL   ? rec_rows_product(t->j, i, 4, true, t->d, t->q, out)
        : t->j->a->cs == 4 ? rec_rows_product(t->j, i, 4, false, t->d, t->q, out)
                           : rec_rows_product(t->j, i, 1, false, t->d, t->q, out);
    else
        FOR_LANES(t, second_differences, t, t->d, t->ld, i - rows, out);
}

/* (5): next; lx follows by alpha ld; the columns that were clipped. */
REC_INLINE void step(struct rec_pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 alpha = rec_coef(t->alpha), zero = {0};
    int32_t n = 0, *clipped = t->j->s->clipped + q0;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 y = rec_ld(t->x, i, cs) + alpha * rec_ld(t->d, i, cs);
        rec_i4 keep = y >= 0;
        rec_st(t->next, i, cs, rec_select(keep, y, zero));
        rec_st(t->lx, i, cs, rec_ld(t->lx, i, cs) + alpha * rec_ld(t->ld, i, cs));
        clipped[n] = (int32_t)i;
        n += !rec_all(keep);
    }
    t->j->s->n_clipped[k] = n;
}
static void step_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    FOR_LANES(t, step, t, k);
}

/* With e = s/alpha - d, not 0 but in the few clipped columns: q += A e, lx += alpha V L e.  Serial: the
 * order of the sums is fixed. */
REC_INLINE void clipped_columns(struct rec_pcg *t, size_t cs)
{
    const struct rec_packed *g = &t->j->a->by_col;
    const struct rec_smooth *s = &t->smooth;
    const int32_t *clipped = t->j->s->clipped;
    rec_f4 alpha = rec_coef(t->alpha), inverse = {0};
    int32_t q0, q1;
    for (int l = 0; l < 4; l++)
        inverse[l] = t->alpha[l] > 0 ? (float)(1 / t->alpha[l]) : 0;
    for (size_t k = 0; k < rec_job_chunks(t->j); k++) {
        rec_chunk_range(t->j->a->n, k, &q0, &q1);
        for (int32_t i = 0; i < t->j->s->n_clipped[k]; i++) {
            int32_t c = clipped[q0 + i];
            rec_f4 x = rec_ld(t->x, (size_t)c, cs), d = rec_ld(t->d, (size_t)c, cs);
            rec_f4 e = rec_select(x + alpha * d < 0, -x * inverse - d, (rec_f4){0}), ae = alpha * e;
            const struct rec_near *nb = &s->near[c];
            ptrdiff_t to[6] = {c - (ptrdiff_t)(nb->have & 1),
                               c + (ptrdiff_t)(nb->have >> 1 & 1),
                               c + nb->y[0],
                               c + nb->y[1],
                               c + nb->z[0],
                               c + nb->z[1]};
            rec_st(t->lx, (size_t)c, cs,
                   rec_ld(t->lx, (size_t)c, cs) +
                       rec_splat(t->stiff[c].by * s->centre[nb->have]) * ae);
            for (int f = 0; f < 6; f++) /* to itself where there is none, as centre[] expects */
                rec_st(t->lx, (size_t)to[f], cs,
                       rec_ld(t->lx, (size_t)to[f], cs) -
                           rec_splat(t->stiff[to[f]].by * s->axis[f / 2]) * ae);
            for (uint32_t at = g->ptr[c]; at < g->ptr[c + 1]; at++) {
                size_t row = rec_packed_index(g, at);
                rec_st(t->q, row, cs,
                       rec_ld(t->q, row, cs) + rec_splat(rec_packed_value(g, at)) * e);
            }
        }
    }
}

static void add_clipped(struct rec_pcg *t)
{
    FOR_LANES(t, clipped_columns, t);
}

/* r += alpha q, r'Wr, q = W r for the adjoint. */
static void residual_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    double *out = t->j->s->part[k][S_A];
    t->j->w4 != NULL   ? rec_rows_step(t->j, k, 4, true, t->alpha, t->r, t->q, t->q, out)
    : t->j->a->cs == 4 ? rec_rows_step(t->j, k, 4, false, t->alpha, t->r, t->q, t->q, out)
                       : rec_rows_step(t->j, k, 1, false, t->alpha, t->r, t->q, t->q, out);
}

static void lx_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    double unused[4];
    FOR_LANES(t, second_differences, t, t->x, t->lx, k, unused);
}

/* phi of (3) from q = W r and lx.  Sums: phi'M phi, phi'M phi_old, x'L lx, ||x||^2. */
REC_INLINE void gradient(struct rec_pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 lambda = rec_coef(t->lambda), zero = {0};
    rec_d4 sum[4] = {0};
    rec_adjoint_range(t->j->a, t->q, q0, q1, t->phi);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs), lx = rec_ld(t->lx, i, cs);
        rec_f4 g =
            rec_ld(t->phi, i, cs) + lambda * rec_smooth_at(&t->smooth, t->lx, (int32_t)i, cs);
        g = rec_select((x > 0) | (g < 0), g, zero);
        rec_st(t->phi, i, cs, g);
        rec_f4 mg = inverse_diagonal(t, i, lambda) * g;
        rec_add_product(&sum[S_A], mg, g);
        rec_add_product(&sum[S_B], mg, rec_ld(t->phi_old, i, cs));
        rec_add_product(&sum[S_C], lx, rec_splat(t->stiff[i].inverse) * lx);
        rec_add_product(&sum[S_D], x, x);
    }
    for (int w = 0; w < 4; w++)
        rec_put(t->j->s->part[k][w], &sum[w]);
}
static void gradient_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    FOR_LANES(t, gradient, t, k);
}

/* phi's and s's of the step from x to next; x in place of next at `back` of the way. */
REC_INLINE void slope(struct rec_pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_d4 sum = {0};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        rec_add_product(&sum, rec_ld(t->next, i, cs) - rec_ld(t->x, i, cs), rec_ld(t->phi, i, cs));
    rec_put(t->j->s->part[k][S_A], &sum);
}
static void slope_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    FOR_LANES(t, slope, t, k);
}
REC_INLINE void retreat(struct rec_pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 back = rec_coef(t->back), zero = {0};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs), y = x + back * (rec_ld(t->next, i, cs) - x);
        rec_st(t->next, i, cs, rec_select(y > 0, y, zero));
    }
}
static void retreat_chunk(void *ctx, size_t k)
{
    struct rec_pcg *t = ctx;
    FOR_LANES(t, retreat, t, k);
}

const struct rec_pcg_passes PASSES = {
    .near = near_chunk,
    .direction = direction_chunk,
    .curvature = curvature_task,
    .step = step_chunk,
    .residual = residual_chunk,
    .smoothness = lx_chunk,
    .gradient = gradient_chunk,
    .slope = slope_chunk,
    .retreat = retreat_chunk,
    .add_clipped = add_clipped,
};
