/* solve_mlem.c - "mlem": maximum-likelihood expectation maximisation.
 *
 *     x_j <- x_j / (sum_i w_i A_ij) * sum_i w_i A_ij max(b_i,0) / (A x)_i                  (1)
 * Source: L. A. Shepp, Y. Vardi, IEEE Trans. Med. Imag. 1(2):113-122, 1982.
 * x stays >= 0 by itself; from zero (1) can not move, so a cold start is the uniform volume that has
 * the images' total.  Warm starts are lifted off zero for the same reason. */
#include <math.h>
#include <string.h>

#include "recon/solve_impl.h"

#define DEFAULT_ITERATIONS 20
#define BEYOND             6

struct mlem {
    struct rec_job *j;
    float *x, *up, *prev;
    float *r, *ratio;
    float least[4]; /* smallest start value per lane */
    bool keep_prev;
};

/* Totals of w max(b,0) per lane. */
static void light_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    int32_t i0, i1;
    size_t cs = (size_t)t->j->a->cs;
    double sum[4] = {0};
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (size_t l = 0; l < cs; l++)
            sum[l] += (double)t->j->w[i] * fmaxf(t->j->b[i * cs + l], 0);
    memcpy(t->j->s->part[k][0], sum, sizeof sum);
}

static void start_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->j->a->cs;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++)
            t->x[i * cs + l] = fmaxf(t->x[i * cs + l], t->least[l]);
}

/* ratio = w max(b,0) / A x, where A x = r + b. */
static void ratio_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    int32_t i0, i1;
    size_t cs = (size_t)t->j->a->cs;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (size_t l = 0; l < cs; l++) {
            size_t o = i * cs + l;
            float b = t->j->b[o], ax = t->r[o] + b, v = t->j->w[i] * fmaxf(b, 0) / ax;
            t->ratio[o] = ax > 0 && isfinite(v) ? v : 0;
        }
}

static void update_chunk(void *ctx, size_t k)
{
    struct mlem *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->j->a->cs;
    rec_adjoint_range(t->j->a, t->ratio, q0, q1, t->up);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        float sens = t->j->s->diag[i];
        for (size_t l = 0; l < cs; l++) {
            size_t o = i * cs + l;
            float x = t->x[o] * (t->up[o] / sens);
            if (t->keep_prev)
                t->prev[o] = t->x[o];
            t->x[o] = sens > 0 && isfinite(x) ? x : 0;
        }
    }
}

void rec_solve_mlem(struct rec_job *j)
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    struct mlem t = {
        .j = j, .x = j->x, .up = s->xv[0], .prev = s->xv[1], .r = s->yv[0], .ratio = s->yv[1]};
    float *best = s->xv[2];
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    uint32_t limit = j->p->iterations > 0 ? j->p->iterations : DEFAULT_ITERATIONS;
    bool corner = j->p->stop == REC_STOP_LCURVE;
    double noise2 = j->p->stop == REC_STOP_DISCREPANCY ? rec_job_noise2(j) : 0;
    struct rec_lcurve curve = {0};
    double sum[4], weight = 0;

    t.keep_prev = corner;
    rec_column_norms(a, s->weight, NULL, s->diag);
    for (int32_t q = 0; q < a->n; q++)
        weight += s->diag[q];
    pvx_pool_run(a->pool, rows, light_chunk, &t);
    rec_job_sum(j, 0, rows, 0, sum);
    bool warm = rec_job_norm_x(j, t.x) > 0;
    for (int l = 0; l < 4; l++) {
        double even = weight > 0 ? sum[l] / weight : 0;
        t.least[l] = (float)(warm ? 1e-2 * even : even);
    }
    pvx_pool_run(a->pool, chunks, start_chunk, &t);

    j->out->status = REC_MAX_ITER;
    for (uint32_t k = 1; k <= limit; k++) {
        if (rec_job_late(j)) {
            j->out->status = REC_DEADLINE;
            break;
        }
        rec_job_residual(j, t.x, t.r, t.ratio, sum);
        double residual2 = sum[0] + sum[1] + sum[2] + sum[3];
        /* The residual is that of the iterate before this update: number k - 1. */
        if (noise2 > 0 && k > 1 && residual2 <= noise2) {
            j->out->status = REC_CONVERGED;
            break;
        }
        if (corner && k > 1) {
            double norm = rec_job_norm_x(j, t.x);
            if (rec_lcurve_add(&curve, k - 1, sqrt(residual2), norm))
                rec_job_copy(j, best, t.prev);
            if (rec_lcurve_done(&curve, k - 1, BEYOND)) {
                j->out->status = REC_CONVERGED;
                break;
            }
        }
        pvx_pool_run(a->pool, rows, ratio_chunk, &t);
        pvx_pool_run(a->pool, chunks, update_chunk, &t);
        j->out->iterations = j->out->best = k;
        if (j->trace != NULL)
            j->trace(j->trace_ctx, k, t.x, 0, sqrt(residual2));
    }
    if (corner && curve.best_k > 0) {
        rec_job_copy(j, t.x, best);
        j->out->best = curve.best_k;
    }
}
