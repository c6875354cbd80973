/* solve_cgls.c - "cgls-paper": the iteration of paper 4.3, taken literally.
 *
 *     a_0 = 0, r_0 = p, d_0 = S^T r_0
 *     alpha = ||S^T r||^2 / ||S d||^2,  a = max(0, a + alpha d),  r = r - alpha S d
 *     beta = ||S^T r_new||^2 / ||S^T r||^2,  d = S^T r_new + beta d                        (1)
 * Source: I. Ihrke, M. Magnor, Image-Based Tomographic Reconstruction of Flames, Eurographics/ACM
 * SIGGRAPH Symposium on Computer Animation 2004, sec. 4.3; CGLS after P. C. Hansen, SIAM 1998.
 * Clipping a_k leaves r_k and d_k to their recursions, so r_k is no longer p - S a_k and the
 * iteration diverges for large k: the stop at the corner of the L-curve is part of the method.  The
 * curve's residual norm is that of the recursion.  Starts at 0 always: with another start (1) would
 * be another method.  Every channel has its own alpha and beta. */
#include <math.h>
#include <string.h>

#include "recon/solve_impl.h"

#define DEFAULT_ITERATIONS 40
#define BEYOND             6 /* points after the corner before it is believed */

enum { S_GAMMA = 0, S_Q = 0, S_R = 0, S_X = 1 };

struct cgls {
    struct rec_job *j;
    float *x, *prev, *d, *s; /* x space */
    float *r, *q;            /* row space; r is W (p - S a) where W is 0/1 */
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
            t->prev[i * cs + l] = x;
            x += (float)t->alpha[l] * t->d[i * cs + l];
            t->x[i * cs + l] = x > 0 ? x : 0;
        }
}

/* s = S^T (W^(1/2) r), which residual_chunk left in q; norms of s and x. */
static void adjoint_chunk(void *ctx, size_t k)
{
    struct cgls *t = ctx;
    int32_t q0, q1;
    size_t cs = (size_t)t->j->a->cs;
    double gamma[4] = {0}, norm[4] = {0};
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_adjoint_range(t->j->a, t->q, q0, q1, t->s);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++) {
            gamma[l] += (double)t->s[i * cs + l] * t->s[i * cs + l];
            norm[l] += (double)t->x[i * cs + l] * t->x[i * cs + l];
        }
    memcpy(t->j->s->part[k][S_GAMMA], gamma, sizeof gamma);
    memcpy(t->j->s->part[k][S_X], norm, sizeof norm);
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

static double total(const double v[4])
{
    return v[0] + v[1] + v[2] + v[3];
}

void rec_solve_cgls(struct rec_job *j)
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    struct cgls t = {.j = j,
                     .x = j->x,
                     .prev = s->xv[0],
                     .d = s->xv[1],
                     .s = s->xv[2],
                     .r = s->yv[0],
                     .q = s->yv[1]};
    float *best = s->xv[3];
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    uint32_t limit = j->p->iterations > 0 ? j->p->iterations : DEFAULT_ITERATIONS;
    bool corner = j->p->stop == REC_STOP_AUTO || j->p->stop == REC_STOP_LCURVE;
    double noise2 = j->p->stop == REC_STOP_DISCREPANCY ? rec_job_noise2(j) : 0;
    struct rec_lcurve curve = {0};
    double gamma[4], sum[4];

    for (size_t i = 0; i < (size_t)a->n * (size_t)a->cs; i++)
        t.x[i] = t.d[i] = 0;
    pvx_pool_run(a->pool, rows, start_chunk, &t);
    pvx_pool_run(a->pool, rows, residual_chunk, &t); /* alpha is 0 */
    pvx_pool_run(a->pool, chunks, adjoint_chunk, &t);
    rec_job_sum(j, 0, chunks, S_GAMMA, gamma);
    pvx_pool_run(a->pool, chunks, direction_chunk, &t); /* beta is 0 */

    j->out->status = REC_MAX_ITER;
    for (uint32_t k = 1; k <= limit; k++) {
        if (rec_job_late(j)) {
            j->out->status = REC_DEADLINE;
            break;
        }
        pvx_pool_run(a->pool, rows, forward_chunk, &t);
        rec_job_sum(j, 0, rows, S_Q, sum);
        bool moving = false;
        for (int l = 0; l < 4; l++) {
            t.alpha[l] = sum[l] > 0 && gamma[l] > 0 ? gamma[l] / sum[l] : 0;
            if (!isfinite((float)t.alpha[l]))
                t.alpha[l] = 0;
            moving = moving || t.alpha[l] > 0;
        }
        if (!moving) {
            j->out->status = REC_CONVERGED;
            break;
        }
        pvx_pool_run(a->pool, chunks, step_chunk, &t);
        pvx_pool_run(a->pool, rows, residual_chunk, &t);
        rec_job_sum(j, 0, rows, S_R, sum);
        double residual = sqrt(total(sum));
        pvx_pool_run(a->pool, chunks, adjoint_chunk, &t);
        double next[4];
        rec_job_sum(j, 0, chunks, S_X, sum);
        rec_job_sum(j, 0, chunks, S_GAMMA, next);
        for (int l = 0; l < 4; l++) {
            t.beta[l] = gamma[l] > 0 ? next[l] / gamma[l] : 0;
            gamma[l] = next[l];
        }
        pvx_pool_run(a->pool, chunks, direction_chunk, &t);
        j->out->iterations = j->out->best = k;
        if (j->trace != NULL)
            j->trace(j->trace_ctx, k, t.x, 0, residual);
        if (corner) {
            if (rec_lcurve_add(&curve, k, residual, sqrt(total(sum))))
                rec_job_copy(j, best, t.prev);
            if (rec_lcurve_done(&curve, k, BEYOND)) {
                j->out->status = REC_CONVERGED;
                break;
            }
        }
        if (noise2 > 0 && residual * residual <= noise2) {
            j->out->status = REC_CONVERGED;
            break;
        }
    }
    if (corner && curve.best_k > 0) {
        rec_job_copy(j, t.x, best);
        j->out->best = curve.best_k;
    }
}
