/* solve_cgls.c - "cgls-paper" and "cgls": the iteration of paper 4.3, taken literally, and without
 * its clipping.
 *
 *     a_0 = 0, r_0 = p, d_0 = S^T r_0
 *     alpha = ||S^T r||^2 / ||S d||^2,  a = max(0, a + alpha d),  r = r - alpha S d
 *     beta = ||S^T r_new||^2 / ||S^T r||^2,  d = S^T r_new + beta d                        (1)
 * Source: I. Ihrke, M. Magnor, Image-Based Tomographic Reconstruction of Flames, Eurographics/ACM
 * SIGGRAPH Symposium on Computer Animation 2004, sec. 4.3; CGLS after P. C. Hansen, SIAM 1998.
 * Clipping a_k leaves r_k and d_k to their recursions, so r_k is no longer p - S a_k and the
 * iteration diverges for large k: the stop at the corner of the L-curve is part of the method.  The
 * residual norm that stops it is that of the recursion.  Starts at 0 always: with another start (1)
 * would be another method.  Every channel has its own alpha and beta.
 * "cgls", for comparison: no max in (1), which is then CGLS itself; its iterates have negative
 * values, the result is clipped once. */
#include <math.h>
#include <string.h>

#include "recon/simd/lanes.h"
#include "recon/solve/stop.h"

enum { S_GAMMA };      /* of columns */
enum { S_SIZE, S_RR }; /* of rows */

struct cgls {
    struct rec_job *j;
    bool clip;
    float *x, *d, *s;  /* x space; s = S^T W r */
    float *r, *q, *wr; /* row space; r of the recursion, q = S d, W r */
    double alpha[4], beta[4];
};

/* q = S d and ||W^(1/2) q||^2. */
static void forward_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    double *out = t->j->s->part[k][S_SIZE];
    t->j->a->cs == 4 ? rec_rows_product(t->j, k, 4, false, t->d, t->q, out)
                     : rec_rows_product(t->j, k, 1, false, t->d, t->q, out);
}

/* r = p, which is 0 + 1 p; W r. */
static void start_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    static const double one[4] = {1, 1, 1, 1};
    double *out = t->j->s->part[k][S_RR];
    size_t cs = (size_t)t->j->a->cs;
    int32_t i0, i1;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    memset(t->r + (size_t)i0 * cs, 0, (size_t)(i1 - i0) * cs * sizeof *t->r);
    cs == 4 ? rec_rows_step(t->j, k, 4, false, one, t->r, t->j->b, t->wr, out)
            : rec_rows_step(t->j, k, 1, false, one, t->r, t->j->b, t->wr, out);
}

REC_INLINE void step(struct cgls *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_f4 alpha = rec_coef(t->alpha), zero = {0};
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs) + alpha * rec_ld(t->d, i, cs);
        rec_st(t->x, i, cs, t->clip ? rec_select(x > 0, x, zero) : x);
    }
}
/* Rows: r -= alpha q, ||W^(1/2) r||^2.  Columns: a += alpha d, clipped. */
static void update_task(void *ctx, size_t i)
{
    struct cgls *t = ctx;
    size_t rows = rec_job_row_chunks(t->j), cs = (size_t)t->j->a->cs;
    double back[4], *out = t->j->s->part[i][S_RR];
    for (int l = 0; l < 4; l++)
        back[l] = -t->alpha[l];
    if (i >= rows)
        cs == 4 ? step(t, i - rows, 4) : step(t, i - rows, 1);
    else
        cs == 4 ? rec_rows_step(t->j, i, 4, false, back, t->r, t->q, t->wr, out)
                : rec_rows_step(t->j, i, 1, false, back, t->r, t->q, t->wr, out);
}

REC_INLINE void adjoint(struct cgls *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_d4 gamma = {0};
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_adjoint_range(t->j->a, t->wr, q0, q1, t->s);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 s = rec_ld(t->s, i, cs);
        rec_add_product(&gamma, s, s);
    }
    rec_put(t->j->s->part[k][S_GAMMA], &gamma);
}
static void adjoint_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    t->j->a->cs == 4 ? adjoint(t, k, 4) : adjoint(t, k, 1);
}

REC_INLINE void direction(struct cgls *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_f4 beta = rec_coef(t->beta);
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        rec_st(t->d, i, cs, rec_ld(t->s, i, cs) + beta * rec_ld(t->d, i, cs));
}
static void direction_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    t->j->a->cs == 4 ? direction(t, k, 4) : direction(t, k, 1);
}

static void zero_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t o = (size_t)q0 * (size_t)t->j->a->cs, n = (size_t)(q1 - q0) * (size_t)t->j->a->cs;
    memset(t->x + o, 0, n * sizeof *t->x);
    memset(t->d + o, 0, n * sizeof *t->d);
}
static void clip_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->j->a->cs;
    for (size_t i = (size_t)q0 * cs; i < (size_t)q1 * cs; i++)
        t->x[i] = t->x[i] > 0 ? t->x[i] : 0;
}

/* alpha of every lane from ||S^T r||^2 and ||S d||^2; false: none can move. */
static bool step_lengths(struct cgls *t, const double gamma[4], const double size[4])
{
    bool moving = false;
    for (int l = 0; l < 4; l++) {
        double alpha = size[l] > 0 && gamma[l] > 0 ? gamma[l] / size[l] : 0;
        t->alpha[l] = isfinite((float)alpha) ? alpha : 0;
        moving = moving || t->alpha[l] > 0;
    }
    return moving;
}

static void solve(struct rec_job *j, bool clip, const struct rec_stop_own *own)
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    struct cgls t = {.j = j,
                     .clip = clip,
                     .x = j->x,
                     .d = s->xv[0],
                     .s = s->xv[1],
                     .r = s->yv[0],
                     .q = s->yv[1],
                     .wr = s->yv[2]};
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    struct rec_stopper stop;
    double gamma[4], sum[4];

    pvx_pool_run(a->pool, chunks, zero_chunk, &t);
    pvx_pool_run(a->pool, rows, start_chunk, &t);
    pvx_pool_run(a->pool, chunks, adjoint_chunk, &t);
    rec_job_sum(j, 0, chunks, S_GAMMA, gamma);
    pvx_pool_run(a->pool, chunks, direction_chunk, &t); /* beta is 0 */
    rec_stop_begin(&stop, j, own, s->xv[2], s->xv[3]);
    while (rec_stop_next(&stop)) {
        pvx_pool_run(a->pool, rows, forward_chunk, &t);
        rec_job_sum(j, 0, rows, S_SIZE, sum);
        if (!step_lengths(&t, gamma, sum)) {
            j->out->status = REC_CONVERGED;
            break;
        }
        pvx_pool_run(a->pool, rows + chunks, update_task, &t);
        rec_job_sum(j, 0, rows, S_RR, sum);
        if (rec_stop_after(&stop, t.x, 0, rec_lanes_total(sum)))
            break;
        pvx_pool_run(a->pool, chunks, adjoint_chunk, &t);
        rec_job_sum(j, 0, chunks, S_GAMMA, sum);
        for (int l = 0; l < 4; l++) {
            t.beta[l] = gamma[l] > 0 ? sum[l] / gamma[l] : 0;
            gamma[l] = sum[l];
        }
        pvx_pool_run(a->pool, chunks, direction_chunk, &t);
    }
    rec_stop_end(&stop, j->x);
    if (!clip)
        pvx_pool_run(a->pool, chunks, clip_chunk, &t);
}

void rec_solve_cgls_paper(struct rec_job *j)
{
    static const struct rec_stop_own own = {.corner = true, .most = 40, .blind = 8, .stall = 0.02};
    solve(j, true, &own);
}

void rec_solve_cgls(struct rec_job *j)
{
    static const struct rec_stop_own own = {.most = 40, .blind = 6, .stall = 0.02};
    solve(j, false, &own);
}
