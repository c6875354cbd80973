/* solve_mlem.c - "mlem": maximum-likelihood expectation maximisation.
 *
 *     x_j <- x_j / (sum_i w_i A_ij) * sum_i w_i A_ij max(b_i,0) / (A x)_i                  (1)
 * Source: L. A. Shepp, Y. Vardi, IEEE Trans. Med. Imag. 1(2):113-122, 1982.
 * x stays >= 0 by itself, and  sum_i w_i ((A x)_i - b_i log (A x)_i)  never rises.  That weighs
 * dark rays more than equal noise asks for: with little noise it is better than least squares, with
 * much it is worse. */
#include <float.h>

#include "recon/simd/lanes.h"
#include "recon/solve/stop.h"

enum { S_RR };

struct mlem {
    struct rec_job *j;
    float *x, *up, *ratio;
};

/* ratio = w max(b,0) / A x, and the residual A x - b. */
REC_INLINE void rows_pass(struct mlem *t, size_t k, size_t cs)
{
    int32_t i0, i1;
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_d4 rr = {0};
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    rec_forward_range(t->j->a, t->x, i0, i1, t->ratio);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        rec_f4 ax = rec_ld(t->ratio, i, cs), b = rec_ld(t->j->b, i, cs);
        rec_f4 w = rec_splat(t->j->w[i]), r = ax - b;
        rec_f4 v = w * rec_select(b > 0, b, zero) / ax;
        rec_st(t->ratio, i, cs, rec_select((ax > 0) & (v <= huge), v, zero));
        rec_add_product(&rr, w * r, r);
    }
    rec_put(t->j->s->part[k][S_RR], &rr);
}
static void rows_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    t->j->a->cs == 4 ? rows_pass(t, k, 4) : rows_pass(t, k, 1);
}

REC_INLINE void columns_pass(struct mlem *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_adjoint_range(t->j->a, t->ratio, q0, q1, t->up);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs) * (rec_ld(t->up, i, cs) / rec_splat(t->j->s->diag[i]));
        rec_st(t->x, i, cs, rec_select((x > 0) & (x <= huge), x, zero));
    }
}
static void columns_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    t->j->a->cs == 4 ? columns_pass(t, k, 4) : columns_pass(t, k, 1);
}

void rec_solve_mlem(struct rec_job *j)
{
    static const struct rec_stop_own own = {.most = 60, .blind = 10, .stall = 0.02};
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    struct mlem t = {.j = j, .x = j->x, .up = s->xv[0], .ratio = s->yv[0]};
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    struct rec_stopper stop;
    double rr[4];

    rec_column_norms(a, s->weight, NULL, s->diag);
    rec_positive_start(j, s->diag, t.x);
    rec_stop_begin(&stop, j, &own, s->xv[1], s->xv[2]);
    pvx_pool_run(a->pool, rows, rows_chunk, &t);
    while (rec_stop_next(&stop)) {
        pvx_pool_run(a->pool, chunks, columns_chunk, &t);
        pvx_pool_run(a->pool, rows, rows_chunk, &t);
        rec_job_sum(j, 0, rows, S_RR, rr);
        if (rec_stop_after(&stop, t.x, 0, rec_lanes_total(rr)))
            break;
    }
    rec_stop_end(&stop, j->x);
}
