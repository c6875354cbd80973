/* solve_pcg.c - "pcg": non-negative regularised least squares by projected preconditioned CG.
 *
 *     f(x) = 1/2 ||W^(1/2) (A x - b)||^2 + lambda/2 ||V^(1/2) L x||^2  ->  min,  x >= 0     (1)
 *     g = A'W(A x - b) + lambda L V L x,   L: smooth.h                                      (2)
 *     V = 1 from a start that knows nothing; from a coarser solution, where it is brighter than
 *         usual less: V_q = (c + y_q / y_mean)^(-1/2), y the start, blurred                 (2a)
 * One iteration:
 *     phi = g where x > 0 or g < 0, else 0          (the bound holds where it should)       (3)
 *     d   = -M phi + beta d,  beta = max(0, phi'M(phi - phi_old) / phi_old'M phi_old)       (4)
 *     x   = max(0, x + alpha d),  alpha = -phi'd / d'Hd                                     (5)
 * H = A'WA + lambda L V L, M = 1/diag(H).  Where (5) clips nothing this is plain CG.  Where it clips,
 * the step is s = alpha (d + e), and e is not 0 in the clipped columns alone: few, so their columns
 * are added to A d and L d (many: A x and L x are formed anew).  f is known after the step; should it
 * have risen, x goes back along s to the least f there, which is feasible because the set is convex:
 * so f never rises.  When d is no descent direction the lane restarts from -M phi.
 * alpha, beta, lambda are per channel.
 * Source: CG (Hestenes & Stiefel, J. Res. NBS 49:409, 1952) with Polak-Ribiere restarts inside
 * Bertsekas' projection of the free variables (SIAM J. Control Optim. 20(2):221, 1982); the
 * arrangement is our own.
 * Cost per iteration: A and A' once, some 20 passes over a vector of voxels, one read or write each. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "recon/solve/passes/pcg_pass.h"
#include "recon/solve/stop.h"

#define DEFAULT_ITERATIONS 30
#define STILL              1e-7 /* share of the objective below which nothing moves any more */
#define REFRESH            64   /* iterations after which A x and L x are formed anew */

/* (2a): how much a flame curves goes with how bright it burns.  c keeps the dark parts from being
 * held more than about three times as firmly as the bright ones. */
#define DARK 0.09

struct brightness {
    struct rec_pcg *t;
    float *at, *blurred; /* [n]: sum over the lanes; its mean over a voxel and its neighbours */
    double mean;
};

static void brightness_chunk(void *ctx, size_t k)
{
    struct brightness *b = ctx;
    const struct rec_job *j = b->t->j;
    size_t cs = (size_t)j->a->cs;
    int32_t q0, q1;
    rec_chunk_range(j->a->n, k, &q0, &q1);
    for (size_t q = (size_t)q0; q < (size_t)q1; q++) {
        const float *x = j->x + q * cs;
        b->at[q] = cs == 4 ? (x[0] + x[1]) + (x[2] + x[3]) : x[0];
    }
}
static void blur_chunk(void *ctx, size_t k)
{
    struct brightness *b = ctx;
    const struct rec_smooth *s = &b->t->smooth;
    double sum = 0, sum2 = 0;
    int32_t q0, q1;
    rec_chunk_range(b->t->j->a->n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        const struct rec_near *e = &s->near[q];
        const float *at = b->at + q;
        float v = 2 * at[0];
        for (int f = 0; f < 2; f++) /* 0 where there is no neighbour */
            v += (e->have >> (2 + f) & 1 ? at[e->y[f]] : 0) +
                 (e->have >> (4 + f) & 1 ? at[e->z[f]] : 0) +
                 (e->have >> f & 1 ? at[2 * f - 1] : 0);
        v *= 0.125f;
        b->blurred[q] = v;
        sum += v;
        sum2 += (double)v * v;
    }
    b->t->j->s->part[k][S_A][0] = sum;
    b->t->j->s->part[k][S_A][1] = sum2;
}
static void stiff_chunk(void *ctx, size_t k)
{
    struct brightness *b = ctx;
    int32_t q0, q1;
    rec_chunk_range(b->t->j->a->n, k, &q0, &q1);
    bool bright = b->mean > 1 / (double)FLT_MAX; /* 1/mean is a float */
    float scale = bright ? (float)(1 / b->mean) : 0;
    for (int32_t q = q0; q < q1; q++) {
        float inverse = bright ? sqrtf((float)DARK + scale * b->blurred[q]) : 1;
        b->t->stiff[q] = (struct rec_stiff){1 / inverse, inverse};
    }
}
/* V from j->x; two vectors of the method serve as work areas.  The mean is weighted by brightness. */
static void stiffness(struct rec_pcg *t)
{
    struct rec_job *j = t->j;
    size_t chunks = rec_job_chunks(j);
    struct brightness b = {.t = t, .at = t->lx, .blurred = t->ld};
    if (j->p->good_start) {
        double sum[4];
        pvx_pool_run(j->a->pool, chunks, brightness_chunk, &b);
        pvx_pool_run(j->a->pool, chunks, blur_chunk, &b);
        rec_job_sum(j, 0, chunks, S_A, sum);
        b.mean = sum[0] > 0 ? sum[1] / sum[0] : 0;
    }
    pvx_pool_run(j->a->pool, chunks, stiff_chunk, &b);
}

/* ---- the method ---------------------------------------------------------------------------------*/

static void swap(float **a, float **b)
{
    float *t = *a;
    *a = *b;
    *b = t;
}

/* Residual and second differences of t->x anew; rwr = r'Wr. */
static void refresh(struct rec_pcg *t, double rwr[4])
{
    const struct rec_pcg_passes *pass = t->j->a->k->pcg;
    rec_job_residual(t->j, t->x, t->r, t->q, rwr);
    pvx_pool_run(t->j->a->pool, rec_job_chunks(t->j), pass->smoothness, t);
}

/* d and alpha; false: no lane can move any more. */
static bool line_search(struct rec_pcg *t, const double gamma[4])
{
    struct rec_job *j = t->j;
    const struct rec_pcg_passes *pass = j->a->k->pcg;
    pvx_pool *pool = j->a->pool;
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    double down[4], qwq[4], ldld[4], keep[4];
    bool again = false, moving = false;

    for (int l = 0; l < 4; l++)
        t->mu[l] = 1;
    pvx_pool_run(pool, chunks, pass->direction, t);
    rec_job_sum(j, 0, chunks, S_A, down);
    for (int l = 0; l < 4; l++) {
        bool restart = t->beta[l] != 0 && down[l] >= -1e-3 * gamma[l];
        again = again || restart;
        keep[l] = restart ? 0 : 1;
    }
    if (again) { /* d = keep d - (1 - keep) M phi: the other lanes stay as they are */
        for (int l = 0; l < 4; l++) {
            t->beta[l] = keep[l];
            t->mu[l] = 1 - keep[l];
        }
        pvx_pool_run(pool, chunks, pass->direction, t);
        rec_job_sum(j, 0, chunks, S_A, down);
    }

    pvx_pool_run(pool, rows + chunks, pass->curvature, t);
    rec_job_sum(j, 0, rows, S_A, qwq);
    rec_job_sum(j, rows, rows + chunks, S_A, ldld);
    for (int l = 0; l < 4; l++) {
        double curve = qwq[l] + t->lambda[l] * ldld[l];
        double alpha = curve > 0 && down[l] < 0 ? -down[l] / curve : 0;
        t->alpha[l] = isfinite((float)alpha) ? alpha : 0;
        moving = moving || t->alpha[l] > 0;
    }
    return moving;
}

/* x, r, q = W r, lx one step further, phi_old the former phi; t->next is then the former x. */
static void advance(struct rec_pcg *t, bool anew, double rwr[4])
{
    struct rec_job *j = t->j;
    const struct rec_pcg_passes *pass = j->a->k->pcg;
    pvx_pool *pool = j->a->pool;
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    int64_t columns = 0;
    pvx_pool_run(pool, chunks, pass->step, t);
    for (size_t k = 0; k < chunks; k++)
        columns += j->s->n_clipped[k];
    if (anew || columns > j->a->n / 8) {
        swap(&t->x, &t->next);
        refresh(t, rwr);
        return;
    }
    if (columns > 0)
        pass->add_clipped(t);
    swap(&t->x, &t->next);
    pvx_pool_run(pool, rows, pass->residual, t);
    rec_job_sum(j, 0, rows, S_A, rwr);
}

/* Gradient of t->x; value of (1) per lane. */
static void evaluate(struct rec_pcg *t, const double rwr[4], double f[4], double gamma[4],
                     double cross[4], double norm2[4])
{
    struct rec_job *j = t->j;
    const struct rec_pcg_passes *pass = j->a->k->pcg;
    size_t chunks = rec_job_chunks(j);
    double lxlx[4];
    swap(&t->phi, &t->phi_old);
    pvx_pool_run(j->a->pool, chunks, pass->gradient, t);
    rec_job_sum(j, 0, chunks, S_A, gamma);
    rec_job_sum(j, 0, chunks, S_B, cross);
    rec_job_sum(j, 0, chunks, S_C, lxlx);
    rec_job_sum(j, 0, chunks, S_D, norm2);
    for (int l = 0; l < 4; l++)
        f[l] = 0.5 * rwr[l] + 0.5 * t->lambda[l] * lxlx[l];
}

/* Some lane's f rose in the step from t->next to t->x: to the least f along that step.  f(t) = f0 +
 * t phi's + t^2 (f1 - f0 - phi's). */
static void go_back(struct rec_pcg *t, const double f0[4], const double f1[4], double rwr[4])
{
    struct rec_job *j = t->j;
    const struct rec_pcg_passes *pass = j->a->k->pcg;
    size_t chunks = rec_job_chunks(j);
    double down[4];
    swap(&t->x, &t->next);
    swap(&t->phi, &t->phi_old);
    pvx_pool_run(j->a->pool, chunks, pass->slope, t);
    rec_job_sum(j, 0, chunks, S_A, down);
    for (int l = 0; l < 4; l++) {
        double bend = f1[l] - f0[l] - down[l];
        double best = bend > 0 && down[l] < 0 ? -down[l] / (2 * bend) : 0;
        t->back[l] = f1[l] <= f0[l] ? 1 : fmin(best, 1);
    }
    pvx_pool_run(j->a->pool, chunks, pass->retreat, t);
    swap(&t->x, &t->next);
    refresh(t, rwr);
}

void rec_solve_pcg(struct rec_job *j)
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    const struct rec_pcg_passes *pass = a->k->pcg;
    struct rec_pcg t = {.j = j,
                        .smooth.near = s->near,
                        .stiff = s->stiff,
                        .x = j->x,
                        .next = s->xv[0],
                        .phi = s->xv[1],
                        .phi_old = s->xv[2],
                        .d = s->xv[3],
                        .lx = s->xv[4],
                        .ld = s->xv[5],
                        .r = s->yv[0],
                        .q = s->yv[1]};
    size_t chunks = rec_job_chunks(j), bytes = (size_t)a->n * (size_t)a->cs * sizeof *j->x;
    const struct rec_stop_own own = {.most = DEFAULT_ITERATIONS,
                                     .blind = DEFAULT_ITERATIONS,
                                     .gain = j->p->stop == REC_STOP_AUTO ? (double)j->p->tolerance
                                                                         : STILL};
    struct rec_stopper stop;

    double noise[4];
    rec_smooth_init(&t.smooth, &a->S->grid);
    pvx_pool_run(a->pool, chunks, pass->near, &t);
    rec_job_lambda(j, t.lambda, noise);
    stiffness(&t);
    for (int l = 0; l < s->nch; l++)
        j->out->lambda += t.lambda[l] / s->nch;
    memset(t.d, 0, bytes);
    memset(t.phi, 0, bytes);

    double gamma[4], cross[4], rwr[4], norm2[4], f[4], now[4], next[4];
    rec_job_start(j, rwr); /* r and q */
    pvx_pool_run(a->pool, chunks, pass->smoothness, &t);
    evaluate(&t, rwr, f, gamma, cross, norm2);
    j->out->objective = rec_lanes_total(f);
    rec_stop_begin(&stop, j, &own, s->xv[6], s->xv[7]);
    while (rec_stop_next(&stop)) {
        if (!line_search(&t, gamma)) {
            j->out->status = REC_CONVERGED;
            break;
        }
        advance(&t, (stop.k + 1) % REFRESH == 0, rwr);
        evaluate(&t, rwr, now, next, cross, norm2);
        bool rose = false;
        for (int l = 0; l < s->nch; l++)
            rose = rose || now[l] > f[l];
        if (rose) {
            go_back(&t, f, now, rwr);
            evaluate(&t, rwr, now, next, cross, norm2);
        }
        for (int l = 0; l < 4; l++) {
            double beta = gamma[l] > 0 ? (next[l] - cross[l]) / gamma[l] : 0;
            t.beta[l] = beta > 0 && isfinite((float)beta) ? beta : 0;
            gamma[l] = next[l];
        }
        memcpy(f, now, sizeof f);
        if (rec_stop_after(&stop, t.x, rec_lanes_total(f), rec_lanes_total(rwr)))
            break;
    }
    if (t.x != j->x)
        rec_job_copy(j, j->x, t.x);
    if (rec_stop_end(&stop, j->x))
        return;
    j->out->residual_norm = sqrt(rec_lanes_total(rwr));
    j->out->solution_norm = sqrt(rec_lanes_total(norm2));
    for (int l = 0; l < s->nch; l++)
        j->out->misfit2[l] = j->w4 == NULL        ? rwr[l] * s->nch / j->m
                             : j->measured[l] > 0 ? rwr[l] / j->measured[l]
                                                  : 0;
}
