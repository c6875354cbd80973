/* solve_cgls.c - "cgls-paper" and "cgls": the iteration of paper 4.3, taken literally, and without its
 * clipping.
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
 * "cgls", for comparison: no max in (1), which is then CGLS itself; its iterates have negative values,
 * the result is clipped once. */
#include <math.h>
#include <string.h>

#include "recon/stop.h"

enum { S_GAMMA };  /* of columns */
enum { S_Q, S_R }; /* of rows */

struct cgls {
    struct rec_job *j;
    bool clip;
    float *x, *d, *s; /* x space */
    float *r, *q;     /* row space; r is W (p - S a) where W is 0/1 */
    double alpha[4], beta[4];
};

static void start_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t i0, i1;
    size_t cs = (size_t)t->j->a->cs;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (size_t l = 0; l < cs; l++) {
            t->r[i * cs + l] = sqrtf(t->j->w[i]) * t->j->b[i * cs + l];
            t->q[i * cs + l] = 0;
        }
}

/* q = W^(1/2) S d and its norms. */
static void forward_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    const struct rec_subsys *a = t->j->a;
    int32_t i0, i1;
    size_t cs = (size_t)a->cs;
    double sum[4] = {0};
    rec_chunk_range(a->rows, k, &i0, &i1);
    rec_forward_range(a, t->d, i0, i1, t->q);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        float w = sqrtf(t->j->w[i]);
        for (size_t l = 0; l < cs; l++) {
            t->q[i * cs + l] *= w;
            sum[l] += (double)t->q[i * cs + l] * t->q[i * cs + l];
        }
    }
    memcpy(t->j->s->part[k][S_Q], sum, sizeof sum);
}

/* r -= alpha q, its norm; then q = W^(1/2) r, what the adjoint takes. */
static void residual_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t i0, i1;
    size_t cs = (size_t)t->j->a->cs;
    double sum[4] = {0};
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        float w = sqrtf(t->j->w[i]);
        for (size_t l = 0; l < cs; l++) {
            float r = t->r[i * cs + l] - (float)t->alpha[l] * t->q[i * cs + l];
            t->r[i * cs + l] = r;
            t->q[i * cs + l] = w * r;
            sum[l] += (double)r * r;
        }
    }
    memcpy(t->j->s->part[k][S_R], sum, sizeof sum);
}

static void step_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->j->a->cs;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++) {
            float x = t->x[i * cs + l];
            x += (float)t->alpha[l] * t->d[i * cs + l];
            t->x[i * cs + l] = x > 0 || !t->clip ? x : 0;
        }
}

/* s = S^T (W^(1/2) r), which residual_chunk left in q, and its norm. */
static void adjoint_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    size_t cs = (size_t)t->j->a->cs;
    double gamma[4] = {0};
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_adjoint_range(t->j->a, t->q, q0, q1, t->s);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++)
            gamma[l] += (double)t->s[i * cs + l] * t->s[i * cs + l];
    memcpy(t->j->s->part[k][S_GAMMA], gamma, sizeof gamma);
}

static void direction_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->j->a->cs;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++)
            t->d[i * cs + l] = t->s[i * cs + l] + (float)t->beta[l] * t->d[i * cs + l];
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
                     .q = s->yv[1]};
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    struct rec_stopper stop;
    double gamma[4], sum[4];

    for (size_t i = 0; i < (size_t)a->n * (size_t)a->cs; i++)
        t.x[i] = t.d[i] = 0;
    pvx_pool_run(a->pool, rows, start_chunk, &t);
    pvx_pool_run(a->pool, rows, residual_chunk, &t); /* alpha is 0 */
    pvx_pool_run(a->pool, chunks, adjoint_chunk, &t);
    rec_job_sum(j, 0, chunks, S_GAMMA, gamma);
    pvx_pool_run(a->pool, chunks, direction_chunk, &t); /* beta is 0 */
    rec_stop_begin(&stop, j, own, s->xv[2], s->xv[3]);
    while (rec_stop_next(&stop)) {
        pvx_pool_run(a->pool, rows, forward_chunk, &t);
        rec_job_sum(j, 0, rows, S_Q, sum);
        if (!step_lengths(&t, gamma, sum)) {
            j->out->status = REC_CONVERGED;
            break;
        }
        pvx_pool_run(a->pool, chunks, step_chunk, &t);
        pvx_pool_run(a->pool, rows, residual_chunk, &t);
        rec_job_sum(j, 0, rows, S_R, sum);
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
    static const struct rec_stop_own own = {.corner = true, .most = 40, .blind = 8, .stall = 0.01};
    solve(j, true, &own);
}

void rec_solve_cgls(struct rec_job *j)
{
    static const struct rec_stop_own own = {.most = 40, .blind = 6, .stall = 0.01};
    solve(j, false, &own);
}
