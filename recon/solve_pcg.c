/* solve_pcg.c - "pcg": non-negative regularised least squares by projected preconditioned CG.
 *
 *     f(x) = 1/2 ||W^(1/2) (A x - b)||^2 + lambda/2 ||L x||^2  ->  min,  x >= 0             (1)
 *     g = A'W(A x - b) + lambda L L x,   L: smooth.h                                        (2)
 * One iteration:
 *     phi = g where x > 0 or g < 0, else 0          (the bound holds where it should)       (3)
 *     d   = -M phi + beta d,  beta = max(0, phi'M(phi - phi_old) / phi_old'M phi_old)       (4)
 *     x   = max(0, x + alpha d),  alpha = -phi'd / d'Hd                                     (5)
 * H = A'WA + lambda L L, M = 1/diag(H).  Where (5) clips nothing this is plain CG.  Where it clips,
 * the step is s = alpha (d + e), and e is not 0 in the clipped columns alone: few, so their columns
 * are added to A d and L d (many: A x and L x are formed anew).  f is known after the step; should it
 * have risen, x goes back along s to the least f there, which is feasible because the set is convex:
 * so f never rises.  When d is no descent direction the lane restarts from -M phi.
 * alpha, beta, lambda are per channel.
 * Source: CG (Hestenes & Stiefel, J. Res. NBS 49:409, 1952) with Polak-Ribiere restarts inside
 * Bertsekas' projection of the free variables (SIAM J. Control Optim. 20(2):221, 1982); the
 * arrangement is our own.
 * Cost per iteration: A and A' once, some 20 passes over a vector of voxels, one read or write each. */
#include <math.h>
#include <string.h>

#include "recon/solve_impl.h"

#define DEFAULT_ITERATIONS 30
#define BEYOND             6
#define REFRESH            64 /* iterations after which A x and L x are formed anew */

enum { S_A, S_B, S_C, S_D };

struct pcg {
    struct rec_job *j;
    struct rec_smooth smooth;
    float *x, *next, *phi, *phi_old, *d, *lx, *ld; /* x space; lx = L x, ld = L d */
    float *e;                                      /* of the clipped columns, one after the other */
    float *r, *q;                                  /* row space: A x - b; A d, then W r */
    double alpha[4], beta[4], mu[4], back[4];
    double lambda[4];
};

#define FOR_LANES(t, fn, ...) \
    ((t)->j->a->cs == 4 ? fn(__VA_ARGS__, (size_t)4) : fn(__VA_ARGS__, (size_t)1))

/* ---- passes -------------------------------------------------------------------------------------*/

static void near_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_smooth_near(&t->smooth, t->j->a, q0, q1);
}

/* M at column i. */
REC_INLINE rec_f4 inverse_diagonal(const struct pcg *t, size_t i, rec_f4 lambda)
{
    rec_f4 h =
        rec_splat(t->j->s->diag[i]) + lambda * rec_splat(t->smooth.diag2[t->smooth.near[i].have]);
    return rec_select(h > 0, rec_splat(1) / h, (rec_f4){0});
}

/* d of (4), and d'phi. */
REC_INLINE void direction(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 beta = rec_coef(t->beta), mu = rec_coef(t->mu), lambda = rec_coef(t->lambda), zero = {0};
    rec_d4 sum = {{0}, {0}};
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
    struct pcg *t = ctx;
    FOR_LANES(t, direction, t, k);
}

/* ld = L d on one chunk of columns and ||ld||^2; or lx = L x. */
REC_INLINE void second_differences(struct pcg *t, const float *v, float *lv, size_t k,
                                   double out[4], size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_d4 sum = {{0}, {0}};
    for (int32_t i = q0; i < q1; i++) {
        rec_f4 lap = rec_smooth_at(&t->smooth, v, i, cs);
        rec_st(lv, (size_t)i, cs, lap);
        rec_add_product(&sum, lap, lap);
    }
    rec_put(out, &sum);
}

/* q = A d on one chunk of rows and q'Wq. */
REC_INLINE void forward(struct pcg *t, size_t k, double out[4], size_t cs)
{
    int32_t i0, i1;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    rec_d4 sum = {{0}, {0}};
    rec_forward_range(t->j->a, t->d, i0, i1, t->q);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        rec_f4 q = rec_ld(t->q, i, cs);
        rec_add_product(&sum, rec_splat(t->j->w[i]) * q, q);
    }
    rec_put(out, &sum);
}

/* What d'Hd is made of.  Rows: q = A d, q'Wq.  Columns: ld = L d, ||ld||^2. */
static void curvature_task(void *ctx, size_t i)
{
    struct pcg *t = ctx;
    size_t rows = rec_job_row_chunks(t->j);
    double *out = t->j->s->part[i][S_A];
    if (i < rows)
        FOR_LANES(t, forward, t, i, out);
    else
        FOR_LANES(t, second_differences, t, t->d, t->ld, i - rows, out);
}

/* (5): next; lx follows by alpha ld; the columns that were clipped. */
REC_INLINE void step(struct pcg *t, size_t k, size_t cs)
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
        n += (keep[0] & keep[1] & keep[2] & keep[3]) == 0;
    }
    t->j->s->n_clipped[k] = n;
}
static void step_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    FOR_LANES(t, step, t, k);
}

/* With e = s/alpha - d, not 0 but in the few clipped columns: q += A e, lx += alpha L e.  Serial: the
 * order of the sums is fixed. */
REC_INLINE void add_clipped(struct pcg *t, size_t cs)
{
    const struct rec_gather *g = &t->j->a->by_col;
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
                   rec_ld(t->lx, (size_t)c, cs) + rec_splat(s->centre[nb->have]) * ae);
            for (int f = 0; f < 6; f++) /* to itself where there is none, as centre[] expects */
                rec_st(t->lx, (size_t)to[f], cs,
                       rec_ld(t->lx, (size_t)to[f], cs) - rec_splat(s->axis[f / 2]) * ae);
            for (uint32_t at = g->ptr[c]; at < g->ptr[c + 1]; at++) {
                size_t row = g->entry[at].idx;
                rec_st(t->q, row, cs, rec_ld(t->q, row, cs) + rec_splat(g->entry[at].val) * e);
            }
        }
    }
}

/* r += alpha q, r'Wr, q = W r for the adjoint. */
REC_INLINE void residual(struct pcg *t, size_t k, size_t cs)
{
    int32_t i0, i1;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    rec_f4 alpha = rec_coef(t->alpha);
    rec_d4 sum = {{0}, {0}};
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        rec_f4 r = rec_ld(t->r, i, cs) + alpha * rec_ld(t->q, i, cs);
        rec_f4 wr = rec_splat(t->j->w[i]) * r;
        rec_st(t->r, i, cs, r);
        rec_st(t->q, i, cs, wr);
        rec_add_product(&sum, wr, r);
    }
    rec_put(t->j->s->part[k][S_A], &sum);
}
static void residual_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    FOR_LANES(t, residual, t, k);
}

static void lx_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    double unused[4];
    FOR_LANES(t, second_differences, t, t->x, t->lx, k, unused);
}

/* phi of (3) from q = W r and lx.  Sums: phi'M phi, phi'M phi_old, ||lx||^2, ||x||^2. */
REC_INLINE void gradient(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 lambda = rec_coef(t->lambda), zero = {0};
    rec_d4 sum[4] = {{{0}, {0}}};
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
        rec_add_product(&sum[S_C], lx, lx);
        rec_add_product(&sum[S_D], x, x);
    }
    for (int w = 0; w < 4; w++)
        rec_put(t->j->s->part[k][w], &sum[w]);
}
static void gradient_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    FOR_LANES(t, gradient, t, k);
}

/* phi's and s's of the step from x to next; x in place of next at `back` of the way. */
REC_INLINE void slope(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_d4 sum = {{0}, {0}};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        rec_add_product(&sum, rec_ld(t->next, i, cs) - rec_ld(t->x, i, cs), rec_ld(t->phi, i, cs));
    rec_put(t->j->s->part[k][S_A], &sum);
}
static void slope_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    FOR_LANES(t, slope, t, k);
}
REC_INLINE void retreat(struct pcg *t, size_t k, size_t cs)
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
    struct pcg *t = ctx;
    FOR_LANES(t, retreat, t, k);
}

/* ---- the method ---------------------------------------------------------------------------------*/

static double total(const double v[4])
{
    return v[0] + v[1] + v[2] + v[3];
}

static void swap(float **a, float **b)
{
    float *t = *a;
    *a = *b;
    *b = t;
}

/* Residual and second differences of t->x anew; rwr = r'Wr. */
static void refresh(struct pcg *t, double rwr[4])
{
    rec_job_residual(t->j, t->x, t->r, t->q, rwr);
    pvx_pool_run(t->j->a->pool, rec_job_chunks(t->j), lx_chunk, t);
}

/* d and alpha; false: no lane can move any more. */
static bool line_search(struct pcg *t, const double gamma[4])
{
    struct rec_job *j = t->j;
    pvx_pool *pool = j->a->pool;
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    double down[4], qwq[4], ldld[4], keep[4];
    bool again = false, moving = false;

    for (int l = 0; l < 4; l++)
        t->mu[l] = 1;
    pvx_pool_run(pool, chunks, direction_chunk, t);
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
        pvx_pool_run(pool, chunks, direction_chunk, t);
        rec_job_sum(j, 0, chunks, S_A, down);
    }

    pvx_pool_run(pool, rows + chunks, curvature_task, t);
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
static void advance(struct pcg *t, bool anew, double rwr[4])
{
    struct rec_job *j = t->j;
    pvx_pool *pool = j->a->pool;
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    int64_t columns = 0;
    pvx_pool_run(pool, chunks, step_chunk, t);
    for (size_t k = 0; k < chunks; k++)
        columns += j->s->n_clipped[k];
    if (anew || columns > j->a->n / 8) {
        swap(&t->x, &t->next);
        refresh(t, rwr);
        return;
    }
    if (columns > 0)
        FOR_LANES(t, add_clipped, t);
    swap(&t->x, &t->next);
    pvx_pool_run(pool, rows, residual_chunk, t);
    rec_job_sum(j, 0, rows, S_A, rwr);
}

/* Gradient of t->x; value of (1) per lane. */
static void evaluate(struct pcg *t, const double rwr[4], double f[4], double gamma[4],
                     double cross[4], double norm2[4])
{
    struct rec_job *j = t->j;
    size_t chunks = rec_job_chunks(j);
    double lxlx[4];
    swap(&t->phi, &t->phi_old);
    pvx_pool_run(j->a->pool, chunks, gradient_chunk, t);
    rec_job_sum(j, 0, chunks, S_A, gamma);
    rec_job_sum(j, 0, chunks, S_B, cross);
    rec_job_sum(j, 0, chunks, S_C, lxlx);
    rec_job_sum(j, 0, chunks, S_D, norm2);
    for (int l = 0; l < 4; l++)
        f[l] = 0.5 * rwr[l] + 0.5 * t->lambda[l] * lxlx[l];
}

/* Some lane's f rose in the step from t->next to t->x: to the least f along that step.  f(t) = f0 +
 * t phi's + t^2 (f1 - f0 - phi's). */
static void go_back(struct pcg *t, const double f0[4], const double f1[4], double rwr[4])
{
    struct rec_job *j = t->j;
    size_t chunks = rec_job_chunks(j);
    double down[4];
    swap(&t->x, &t->next);
    swap(&t->phi, &t->phi_old);
    pvx_pool_run(j->a->pool, chunks, slope_chunk, t);
    rec_job_sum(j, 0, chunks, S_A, down);
    for (int l = 0; l < 4; l++) {
        double bend = f1[l] - f0[l] - down[l];
        double best = bend > 0 && down[l] < 0 ? -down[l] / (2 * bend) : 0;
        t->back[l] = f1[l] <= f0[l] ? 1 : fmin(best, 1);
    }
    pvx_pool_run(j->a->pool, chunks, retreat_chunk, t);
    swap(&t->x, &t->next);
    refresh(t, rwr);
}

void rec_solve_pcg(struct rec_job *j)
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    struct pcg t = {.j = j,
                    .smooth.near = s->near,
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
    uint32_t limit = j->p->iterations > 0 ? j->p->iterations : DEFAULT_ITERATIONS;
    bool corner = j->p->stop == REC_STOP_LCURVE;
    struct rec_lcurve curve = {0};
    double best_f = 0;
    float *best = s->xv[6];
    double noise2 = j->p->stop == REC_STOP_DISCREPANCY ? rec_job_noise2(j) : 0;
    double tol = j->p->stop == REC_STOP_AUTO ? (double)j->p->tolerance : 1e-7;

    rec_smooth_init(&t.smooth, &a->S->grid);
    pvx_pool_run(a->pool, chunks, near_chunk, &t);
    rec_job_lambda(j, t.lambda);
    for (int l = 0; l < s->nch; l++)
        j->out->lambda += t.lambda[l] / s->nch;
    memset(t.d, 0, bytes);
    memset(t.phi, 0, bytes);

    double gamma[4], cross[4], rwr[4], norm2[4], f[4], now[4], next[4];
    rec_job_start(j, rwr); /* r and q */
    pvx_pool_run(a->pool, chunks, lx_chunk, &t);
    evaluate(&t, rwr, f, gamma, cross, norm2);
    j->out->objective = total(f);
    j->out->status = REC_MAX_ITER;
    for (uint32_t k = 1; k <= limit; k++) {
        if (rec_job_late(j)) {
            j->out->status = REC_DEADLINE;
            break;
        }
        if (!line_search(&t, gamma)) {
            j->out->status = REC_CONVERGED;
            break;
        }
        advance(&t, k % REFRESH == 0, rwr);
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
        double gain = total(f) - total(now);
        double before = total(f);
        memcpy(f, now, sizeof f);
        j->out->objective = total(f);
        j->out->iterations = j->out->best = k;
        if (j->trace != NULL)
            j->trace(j->trace_ctx, k, t.x, total(f), sqrt(total(rwr)));
        if (corner) {
            if (rec_lcurve_add(&curve, k, sqrt(total(rwr)), sqrt(total(norm2)))) {
                rec_job_copy(j, best, t.next); /* the iterate before */
                best_f = before;
            }
            if (rec_lcurve_done(&curve, k, BEYOND)) {
                j->out->status = REC_CONVERGED;
                break;
            }
        }
        if (gain <= tol * total(f) || (noise2 > 0 && total(rwr) <= noise2)) {
            j->out->status = REC_CONVERGED;
            break;
        }
    }
    if (corner && curve.best_k > 0) {
        rec_job_copy(j, j->x, best);
        j->out->best = curve.best_k;
        j->out->objective = best_f;
    } else if (t.x != j->x) {
        rec_job_copy(j, j->x, t.x);
    }
}
