/* cgls.c - "cgls-paper" and "cgls": the iteration of paper 4.3, taken literally, and without
 * its clipping.
 *
 *     a_0 = 0, r_0 = p, d_0 = S^T r_0
 *     alpha = ||S^T r||^2 / ||S d||^2,  a = max(0, a + alpha d),  r = r - alpha S d
 *     beta = ||S^T r_new||^2 / ||S^T r||^2,  d = S^T r_new + beta d                        (1)
 * Source: I. Ihrke, M. Magnor, Image-Based Tomographic Reconstruction of Flames, Eurographics/ACM
 * SIGGRAPH Symposium on Computer Animation 2004, sec. 4.3; CGLS after P. C. Hansen, SIAM 1998.
 * Clipping a_k does not change the recursions of r_k and d_k.  So r_k is no longer p - S a_k, and the
 * iteration diverges for large k: the stop at the corner of the L-curve is part of the method.  The
 * residual norm that stops it is that of the recursion.  It always starts at 0, because with another
 * start (1) would be another method.  Every channel has its own alpha and beta.
 * "cgls", for comparison: no max in (1), which is then CGLS itself; its iterates have negative
 * values, the result is clipped once.
 * A channel whose ||S^T r|| is below FLOOR of its first has converged.  What is left is rounding, which no longer falls:
 * beta is about 1, rounding adds up in d, and where it cancels out alpha has no limit. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "recon/simd/lanes.h"
#include "recon/solve/stop.h"

#define FLOOR (8 * FLT_EPSILON)

enum { S_GAMMA };      /* of columns */
enum { S_SIZE, S_RR }; /* of rows */

struct cgls {
    rec_problem *pb;
    bool clip;
    float *x, *d, *s;  /* x space; s = S^T W r */
    float *r, *q, *wr; /* row space; r of the recursion, q = S d, W r */
    double alpha[4], beta[4];
    double least[4]; /* of gamma = ||S^T r||^2 */
};

/* q = S d and ||W^(1/2) q||^2. */
static void cgls_forward_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    double *out = t->pb->part[k][S_SIZE];
    t->pb->cs == 4 ? rec_rows_product(t->pb, k, 4, false, t->q, out)
                   : rec_rows_product(t->pb, k, 1, false, t->q, out);
}

/* r = p, which is 0 + 1 p; W r. */
static void start_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    static const double one[4] = {1, 1, 1, 1};
    double *out = t->pb->part[k][S_RR];
    size_t cs = (size_t)t->pb->cs;
    REC_FOR_ROWS (i, t->pb->a, k)
        memset(t->r + i * cs, 0, cs * sizeof *t->r);
    cs == 4 ? rec_rows_step(t->pb, k, 4, false, one, t->r, t->pb->b, t->wr, out)
            : rec_rows_step(t->pb, k, 1, false, one, t->r, t->pb->b, t->wr, out);
}

REC_INLINE void step(struct cgls *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_f4 alpha = rec_coef(t->alpha), zero = {0};
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs) + alpha * rec_ld(t->d, i, cs);
        rec_st(t->x, i, cs, t->clip ? rec_select(x > 0, x, zero) : x);
    }
}
/* Rows: r -= alpha q, ||W^(1/2) r||^2.  Columns: a += alpha d, clipped. */
static void cgls_update_task(void *ctx, size_t i)
{
    struct cgls *t = ctx;
    size_t rows = rec_row_chunks(t->pb), cs = (size_t)t->pb->cs;
    double back[4], *out = t->pb->part[i][S_RR];
    for (int l = 0; l < 4; l++)
        back[l] = -t->alpha[l];
    if (i >= rows)
        cs == 4 ? step(t, i - rows, 4) : step(t, i - rows, 1);
    else
        cs == 4 ? rec_rows_step(t->pb, i, 4, false, back, t->r, t->q, t->wr, out)
                : rec_rows_step(t->pb, i, 1, false, back, t->r, t->q, t->wr, out);
}

REC_INLINE void adjoint(struct cgls *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_d4 gamma = {0};
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    rec_adjoint_range(t->pb->a, t->wr, q0, q1, t->s);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 s = rec_ld(t->s, i, cs);
        rec_add_product(&gamma, s, s);
    }
    rec_put(t->pb->part[k][S_GAMMA], &gamma);
}
static void adjoint_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    t->pb->cs == 4 ? adjoint(t, k, 4) : adjoint(t, k, 1);
}

REC_INLINE void cgls_along(struct cgls *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_f4 beta = rec_coef(t->beta);
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        rec_st(t->d, i, cs, rec_ld(t->s, i, cs) + beta * rec_ld(t->d, i, cs));
}
static void cgls_direction_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    t->pb->cs == 4 ? cgls_along(t, k, 4) : cgls_along(t, k, 1);
}

static void cgls_zero_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    size_t o = (size_t)q0 * (size_t)t->pb->cs, n = (size_t)(q1 - q0) * (size_t)t->pb->cs;
    memset(t->x + o, 0, n * sizeof *t->x);
    memset(t->d + o, 0, n * sizeof *t->d);
}
static void clip_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->pb->cs;
    for (size_t i = (size_t)q0 * cs; i < (size_t)q1 * cs; i++)
        t->x[i] = t->x[i] > 0 ? t->x[i] : 0;
}

/* alpha of every lane from ||S^T r||^2 and ||S d||^2; false: none can move. */
static bool cgls_step_lengths(struct cgls *t, const double gamma[4], const double size[4])
{
    bool moving = false;
    for (int l = 0; l < 4; l++) {
        double alpha = size[l] > 0 && gamma[l] > t->least[l] ? gamma[l] / size[l] : 0;
        t->alpha[l] = isfinite((float)alpha) ? alpha : 0;
        moving = moving || t->alpha[l] > 0;
    }
    return moving;
}

struct variant {
    bool clip;
    struct rec_stop_own own;
};
static void cgls_solve(rec_problem *pb, const struct variant *v, const struct rec_solve_params *p,
                       float *x, struct rec_solve_report *out)
{
    struct cgls t = {.pb = pb,
                     .clip = v->clip,
                     .x = x,
                     .d = pb->xv[0],
                     .s = pb->xv[1],
                     .r = pb->yv[0],
                     .q = pb->yv[1],
                     .wr = pb->yv[2]};
    pvx_pool *pool = pb->a->pool;
    size_t rows = rec_row_chunks(pb), chunks = rec_column_chunks(pb);
    struct rec_stopper stop;
    double gamma[4], sum[4];

    pvx_pool_run(pool, chunks, cgls_zero_chunk, &t);      /* a = d = 0 */
    pvx_pool_run(pool, rows, start_chunk, &t);            /* r = p */
    pvx_pool_run(pool, chunks, adjoint_chunk, &t);        /* s = S^T r, gamma = ||s||^2 */
    pvx_pool_run(pool, chunks, cgls_direction_chunk, &t); /* d = s: beta is 0 */
    rec_sum(pb, 0, chunks, S_GAMMA, gamma);
    for (int l = 0; l < 4; l++)
        t.least[l] = FLOOR * FLOOR * gamma[l];
    rec_stop_begin(&stop, pb, &v->own, p, out);
    while (rec_stop_next(&stop)) {
        rec_start_product(pb, t.d);
        pvx_pool_run(pool, rows, cgls_forward_chunk, &t); /* q = S d */
        rec_sum(pb, 0, rows, S_SIZE, sum);
        if (!cgls_step_lengths(&t, gamma, sum)) { /* alpha = gamma / ||q||^2 */
            out->status = REC_CONVERGED;
            break;
        }
        pvx_pool_run(pool, rows + chunks, cgls_update_task, &t); /* a += alpha d, r -= alpha q */
        rec_sum(pb, 0, rows, S_RR, sum);
        if (rec_stop_after(&stop, t.x, 0, rec_lanes_total(sum)))
            break;
        pvx_pool_run(pool, chunks, adjoint_chunk, &t); /* s = S^T r */
        rec_sum(pb, 0, chunks, S_GAMMA, sum);
        for (int l = 0; l < 4; l++) {
            t.beta[l] = gamma[l] > 0 ? sum[l] / gamma[l] : 0;
            gamma[l] = sum[l];
        }
        pvx_pool_run(pool, chunks, cgls_direction_chunk, &t); /* d = s + beta d */
    }
    rec_stop_end(&stop, x);
    if (!v->clip)
        pvx_pool_run(pool, chunks, clip_chunk, &t);
}

void rec_solve_cgls_paper(rec_problem *pb, const struct rec_solve_params *p, float *x,
                          struct rec_solve_report *out)
{
    static const struct variant v = {true, {.corner = true, .most = 40, .blind = 8, .stall = 0.02}};
    cgls_solve(pb, &v, p, x, out);
}

void rec_solve_cgls(rec_problem *pb, const struct rec_solve_params *p, float *x,
                    struct rec_solve_report *out)
{
    static const struct variant v = {false, {.most = 40, .blind = 6, .stall = 0.02}};
    cgls_solve(pb, &v, p, x, out);
}
