/* mlem.c - "mlem": maximum-likelihood expectation maximisation.
 *
 *     x_j <- x_j / (sum_i w_i A_ij) * sum_i w_i A_ij max(b_i,0) / (A x)_i                  (1)
 * Source: L. A. Shepp, Y. Vardi, IEEE Trans. Med. Imag. 1(2):113-122, 1982.
 * x stays >= 0 by itself, and  sum_i w_i ((A x)_i - b_i log (A x)_i)  never rises.  That gives
 * dark rays more weight than equal noise asks for: the method is better than least squares with little
 * noise, and worse with much. */
#include <float.h>

#include "recon/simd/lanes.h"
#include "recon/solve/stop.h"

enum { S_RR };

struct mlem {
    rec_problem *pb;
    float *x, *up, *ratio;
};

/* ratio = w max(b,0) / A x, and the residual A x - b. */
REC_INLINE void mlem_rows_pass(struct mlem *t, size_t k, size_t cs)
{
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_d4 rr = {0};
    rec_take_product(t->pb, k, t->ratio);
    REC_FOR_ROWS (i, t->pb->a, k) {
        rec_f4 ax = rec_ld(t->ratio, i, cs), b = rec_ld(t->pb->b, i, cs);
        rec_f4 w = rec_splat(t->pb->w[i]), r = ax - b;
        rec_f4 v = w * rec_select(b > 0, b, zero) / ax;
        rec_st(t->ratio, i, cs, rec_select((ax > 0) & (v <= huge), v, zero));
        rec_add_product(&rr, w * r, r);
    }
    rec_put(t->pb->part[k][S_RR], &rr);
}
static void mlem_rows_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    t->pb->cs == 4 ? mlem_rows_pass(t, k, 4) : mlem_rows_pass(t, k, 1);
}

REC_INLINE void mlem_columns_pass(struct mlem *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    rec_adjoint_range(t->pb->a, t->ratio, q0, q1, t->up);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs) * (rec_ld(t->up, i, cs) / rec_splat(t->pb->column[i]));
        rec_st(t->x, i, cs, rec_select((x > 0) & (x <= huge), x, zero));
    }
}
/* ratio and r'Wr of x. */
static void mlem_compare(struct mlem *t, double rr[4])
{
    size_t rows = rec_row_chunks(t->pb);
    rec_start_product(t->pb, t->x);
    pvx_pool_run(t->pb->a->pool, rows, mlem_rows_chunk, t);
    rec_sum(t->pb, 0, rows, S_RR, rr);
}
static void mlem_columns_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    t->pb->cs == 4 ? mlem_columns_pass(t, k, 4) : mlem_columns_pass(t, k, 1);
}

void rec_solve_mlem(rec_problem *pb, const struct rec_solve_params *p, float *x,
                    struct rec_solve_report *out)
{
    static const struct rec_stop_own own = {.most = 60, .blind = 10, .stall = 0.02};
    struct mlem t = {.pb = pb, .x = x, .up = pb->xv[0], .ratio = pb->yv[0]};
    pvx_pool *pool = pb->a->pool;
    size_t chunks = rec_column_chunks(pb);
    struct rec_stopper stop;
    double rr[4];

    rec_column_norms(pb->a, pb->w, NULL, pb->column); /* A'w */
    rec_start_positive(pb, pb->column, x);
    rec_stop_begin(&stop, pb, &own, p, out);
    mlem_compare(&t, rr); /* ratio = w b / A x */
    while (rec_stop_next(&stop)) {
        pvx_pool_run(pool, chunks, mlem_columns_chunk, &t); /* x *= A'ratio / A'w */
        mlem_compare(&t, rr);                               /* ratio = w b / A x, r = A x - b */
        if (rec_stop_after(&stop, x, 0, rec_lanes_total(rr)))
            break;
    }
    rec_stop_end(&stop, x);
}
