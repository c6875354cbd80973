/* solve_pcg.c - "pcg": non-negative regularised least squares by projected preconditioned CG.
 *
 *     f(x) = 1/2 ||W^(1/2) (A x - b)||^2 + lambda/2 ||D x||^2  ->  min,  x >= 0            (1)
 *     g = A'W(A x - b) + lambda L x,   L = D'D                                              (2)
 * D: differences between face neighbours, weighted by (h_min/h_axis)^2.
 * One iteration:
 *     phi = g where x > 0 or g < 0, else 0          (the bound holds where it should)       (3)
 *     d   = -M phi + beta d,  beta = max(0, phi'M(phi - phi_old) / phi_old'M phi_old)       (4)
 *     s   = max(0, x + alpha d) - x,  alpha = -phi'd / d'Hd                                 (5)
 *     x  += t s,  t = min(1, -phi's / s'Hs)                                                 (6)
 * H = A'WA + lambda L, M = 1/diag(H).  x + t s is feasible for t in [0,1] because the set is convex,
 * and t minimises f along s, so f never rises.  Where (5) clips nothing, s = alpha d and t = 1: plain
 * CG.  Where it clips, A s = alpha A d + A e with e non-zero only in the clipped columns, so the
 * exact search costs a product with those alone.  When s is no descent direction the lane restarts
 * from -M phi.  alpha, beta, t are per channel.
 * Source: CG (Hestenes & Stiefel, J. Res. NBS 49:409, 1952) with Polak-Ribiere restarts inside
 * Bertsekas' projection of the free variables (SIAM J. Control Optim. 20(2):221, 1982); the
 * arrangement is our own. */
#include <math.h>

#include "recon/solve_impl.h"

#define DEFAULT_ITERATIONS 30
#define BEYOND 6

enum { S_A, S_B, S_C, S_D };

struct pcg {
    struct rec_job *j;
    float *x, *phi, *phi_old, *d, *s, *e, *prev; /* x space */
    float *r, *q;                                /* row space */
    double alpha[4], beta[4], mu[4], t[4], on_q[4];
    float lambda;
    float axis[3];
    bool keep_prev;
};

/* ---- neighbours ---------------------------------------------------------------------------------*/

/* First active index whose voxel is >= v. */
static int32_t lower_bound(const int32_t *col, int32_t n, int32_t v)
{
    int32_t lo = 0, hi = n;
    while (lo < hi) {
        int32_t mid = lo + (hi - lo) / 2;
        if (col[mid] < v)
            lo = mid + 1;
        else
            hi = mid;
    }
    return lo;
}

/* col is ascending, so the neighbour at a fixed offset moves forward with q: no search per voxel. */
static void neighbours_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    const struct rec_subsys *a = t->j->a;
    const struct rec_grid *g = &a->S->grid;
    int32_t q0, q1, n = a->n;
    rec_job_range(t->j, k, &q0, &q1);
    const int32_t *col = a->col;
    const int32_t step[6] = {-1, 1, -g->n[0], g->n[0], -g->n[0] * g->n[1], g->n[0] * g->n[1]};
    int32_t at[6];
    for (int f = 0; f < 6; f++)
        at[f] = lower_bound(col, n, col[q0] + step[f]);
    for (int32_t q = q0; q < q1; q++) {
        int32_t ijk[3];
        rec_grid_ijk(g, col[q], ijk);
        for (int f = 0; f < 6; f++) {
            int32_t want = col[q] + step[f], c = ijk[f / 2] + (f & 1 ? 1 : -1);
            while (at[f] < n && col[at[f]] < want)
                at[f]++;
            bool have = c >= 0 && c < g->n[f / 2] && at[f] < n && col[at[f]] == want;
            t->j->s->nbr[q][f] = have ? at[f] : q;
        }
    }
}

/* out = (L v) at q, all lanes.  A missing neighbour is q itself: no difference, no penalty. */
static inline void laplace(const struct pcg *t, const float *v, size_t q, size_t cs, float *out)
{
    const int32_t *nb = t->j->s->nbr[q];
    for (size_t l = 0; l < cs; l++)
        out[l] = 0;
    for (int f = 0; f < 6; f++) {
        const float *u = v + (size_t)nb[f] * cs;
        for (size_t l = 0; l < cs; l++)
            out[l] += t->axis[f / 2] * (v[q * cs + l] - u[l]);
    }
}

static void precondition_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    int32_t q0, q1;
    rec_job_range(t->j, k, &q0, &q1);
    float *diag = t->j->s->diag;
    for (int32_t q = q0; q < q1; q++) {
        float h = diag[q];
        for (int f = 0; f < 6; f++)
            h += t->j->s->nbr[q][f] != q ? t->lambda * t->axis[f / 2] : 0;
        diag[q] = h > 0 ? 1 / h : 0;
    }
}

/* ---- passes -------------------------------------------------------------------------------------*/

static inline __attribute__((always_inline)) void direction(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_job_range(t->j, k, &q0, &q1);
    const float *m = t->j->s->diag;
    double sum[4] = {0};
    float beta[4], mu[4];
    for (size_t l = 0; l < 4; l++) {
        beta[l] = (float)t->beta[l];
        mu[l] = (float)t->mu[l];
    }
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++) {
            size_t o = i * cs + l;
            float d = beta[l] * t->d[o] - mu[l] * m[i] * t->phi[o];
            d = t->x[o] > 0 || t->phi[o] < 0 ? d : 0;
            t->d[o] = d;
            sum[l] += (double)d * t->phi[o];
        }
    for (int l = 0; l < 4; l++)
        t->j->s->part[k][S_A][l] = sum[l];
}
static void direction_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? direction(t, k, 4) : direction(t, k, 1);
}

/* v'Lv of one chunk, v = d or s. */
static inline __attribute__((always_inline)) void roughness(struct pcg *t, const float *v, size_t k,
                                                            size_t cs, double out[4])
{
    int32_t q0, q1;
    rec_job_range(t->j, k, &q0, &q1);
    double sum[4] = {0};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        float lap[4];
        laplace(t, v, i, cs, lap);
        for (size_t l = 0; l < cs; l++)
            sum[l] += (double)lap[l] * v[i * cs + l];
    }
    for (int l = 0; l < 4; l++)
        out[l] = sum[l];
}

/* q'Wq of camera c. */
static inline __attribute__((always_inline)) void weighted_norm(struct pcg *t, size_t c, size_t cs,
                                                                double out[4])
{
    size_t i0, i1;
    rec_job_rows(t->j, c, &i0, &i1);
    const float *w = t->j->s->weight;
    double sum[4] = {0};
    for (size_t i = i0; i < i1; i++)
        for (size_t l = 0; l < cs; l++)
            sum[l] += (double)(w[i] * t->q[i * cs + l]) * t->q[i * cs + l];
    for (int l = 0; l < 4; l++)
        out[l] = sum[l];
}

/* Cameras: q = A d, q'Wq.  Chunks: d'Ld. */
static void forward_task(void *ctx, size_t i)
{
    struct pcg *t = ctx;
    const struct rec_subsys *a = t->j->a;
    size_t cameras = a->S->n_cameras, cs = (size_t)a->cs, i0, i1;
    double *out = t->j->s->part[i][S_A];
    if (i >= cameras) {
        a->cs == 4 ? roughness(t, t->d, i - cameras, 4, out) : roughness(t, t->d, i - cameras, 1, out);
        return;
    }
    rec_job_rows(t->j, i, &i0, &i1);
    if (i0 < i1) {
        for (size_t o = i0 * cs; o < i1 * cs; o++)
            t->q[o] = 0;
        (a->cs == 4 ? a->k->scatter4 : a->k->scatter1)(&a->S->block[i], a->col, 0, a->n, t->d,
                                                       t->q + a->row0[i] * cs);
    }
    a->cs == 4 ? weighted_norm(t, i, 4, out) : weighted_norm(t, i, 1, out);
}

/* s by (5), phi's, and the clipped columns with their e = s - alpha d. */
static inline __attribute__((always_inline)) void step(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1, n = 0;
    rec_job_range(t->j, k, &q0, &q1);
    double sum[4] = {0}, clips[4] = {0};
    float alpha[4];
    for (size_t l = 0; l < 4; l++)
        alpha[l] = (float)t->alpha[l];
    for (int32_t q = q0; q < q1; q++) {
        bool clip = false;
        for (size_t l = 0; l < cs; l++) {
            size_t o = (size_t)q * cs + l;
            float full = alpha[l] * t->d[o], to = t->x[o] + full;
            float s = to >= 0 ? full : -t->x[o];
            clip = clip || to < 0;
            clips[l] += to < 0;
            t->s[o] = s;
            t->e[((size_t)q0 + (size_t)n) * cs + l] = s - full;
            sum[l] += (double)s * t->phi[o];
        }
        t->j->s->clipped[q0 + n] = t->j->a->col[q];
        n += clip;
    }
    t->j->s->n_clipped[k] = n;
    for (int l = 0; l < 4; l++) {
        t->j->s->part[k][S_A][l] = sum[l];
        t->j->s->part[k][S_B][l] = clips[l];
    }
}
static void step_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? step(t, k, 4) : step(t, k, 1);
}

/* Cameras: q = alpha q + A e = A s, q'Wq.  Chunks: s'Ls. */
static void clipped_task(void *ctx, size_t i)
{
    struct pcg *t = ctx;
    const struct rec_subsys *a = t->j->a;
    size_t cameras = a->S->n_cameras, cs = (size_t)a->cs, i0, i1, chunks = rec_job_chunks(t->j);
    double *out = t->j->s->part[i][S_A];
    if (i >= cameras) {
        a->cs == 4 ? roughness(t, t->s, i - cameras, 4, out) : roughness(t, t->s, i - cameras, 1, out);
        return;
    }
    rec_job_rows(t->j, i, &i0, &i1);
    float alpha[4];
    for (size_t l = 0; l < 4; l++)
        alpha[l] = (float)t->alpha[l];
    for (size_t o = i0; o < i1; o++)
        for (size_t l = 0; l < cs; l++)
            t->q[o * cs + l] *= alpha[l];
    for (size_t k = 0; i0 < i1 && k < chunks; k++) {
        int32_t q0, q1;
        rec_job_range(t->j, k, &q0, &q1);
        (a->cs == 4 ? a->k->scatter4 : a->k->scatter1)(
            &a->S->block[i], t->j->s->clipped, q0, q0 + t->j->s->n_clipped[k], t->e,
            t->q + a->row0[i] * cs);
    }
    a->cs == 4 ? weighted_norm(t, i, 4, out) : weighted_norm(t, i, 1, out);
}

/* Cameras: r += on_q q, r'Wr, q = W r for the adjoint.  Chunks: x += t s. */
static inline __attribute__((always_inline)) void update_rows(struct pcg *t, size_t c, size_t cs)
{
    size_t i0, i1;
    rec_job_rows(t->j, c, &i0, &i1);
    const float *w = t->j->s->weight;
    double sum[4] = {0};
    float on_q[4];
    for (size_t l = 0; l < 4; l++)
        on_q[l] = (float)t->on_q[l];
    for (size_t i = i0; i < i1; i++)
        for (size_t l = 0; l < cs; l++) {
            size_t o = i * cs + l;
            float r = t->r[o] + on_q[l] * t->q[o], wr = w[i] * r;
            t->r[o] = r;
            t->q[o] = wr;
            sum[l] += (double)wr * r;
        }
    for (int l = 0; l < 4; l++)
        t->j->s->part[c][S_A][l] = sum[l];
}
static void update_task(void *ctx, size_t i)
{
    struct pcg *t = ctx;
    size_t cameras = t->j->a->S->n_cameras, cs = (size_t)t->j->a->cs;
    if (i < cameras) {
        cs == 4 ? update_rows(t, i, 4) : update_rows(t, i, 1);
        return;
    }
    int32_t q0, q1;
    rec_job_range(t->j, i - cameras, &q0, &q1);
    float on_s[4];
    for (size_t l = 0; l < 4; l++)
        on_s[l] = (float)t->t[l];
    for (size_t q = (size_t)q0; q < (size_t)q1; q++)
        for (size_t l = 0; l < cs; l++) {
            size_t o = q * cs + l;
            if (t->keep_prev)
                t->prev[o] = t->x[o];
            float x = t->x[o] + on_s[l] * t->s[o];
            t->x[o] = x > 0 ? x : 0;
        }
}

/* phi from q = W r and x by (2), (3).  Sums: phi'M phi, phi'M phi_old, x'Lx, x'x. */
static inline __attribute__((always_inline)) void gradient(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_job_range(t->j, k, &q0, &q1);
    const float *m = t->j->s->diag;
    double sum[4][4] = {{0}};
    rec_adjoint_range(t->j->a, t->q, q0, q1, t->phi);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        float lap[4];
        laplace(t, t->x, i, cs, lap);
        for (size_t l = 0; l < cs; l++) {
            size_t o = i * cs + l;
            float g = t->phi[o] + t->lambda * lap[l], x = t->x[o];
            g = x > 0 || g < 0 ? g : 0;
            t->phi[o] = g;
            double mg = (double)m[i] * g;
            sum[S_A][l] += mg * g;
            sum[S_B][l] += mg * t->phi_old[o];
            sum[S_C][l] += (double)lap[l] * x;
            sum[S_D][l] += (double)x * x;
        }
    }
    for (int w = 0; w < 4; w++)
        for (int l = 0; l < 4; l++)
            t->j->s->part[k][w][l] = sum[w][l];
}
static void gradient_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? gradient(t, k, 4) : gradient(t, k, 1);
}

/* ---- the method ---------------------------------------------------------------------------------*/

static double total(const double v[4])
{
    return v[0] + v[1] + v[2] + v[3];
}

/* Value of (1) after update_task left r'Wr in `rwr` and gradient_chunk x'Lx in `xlx`. */
static double objective(const struct pcg *t, const double rwr[4], const double xlx[4])
{
    return 0.5 * total(rwr) + 0.5 * (double)t->lambda * total(xlx);
}

static float choose_lambda(const struct rec_job *j, double mean_diag)
{
    float rel = j->p->lambda;
    if (rel < 0)
        rel = 0.05f;
    return (float)(rel * mean_diag);
}

/* v'Hv per lane, after a pass that left q'Wq of the cameras and then v'Lv of the chunks. */
static void curvature(const struct pcg *t, double out[4])
{
    size_t cameras = t->j->a->S->n_cameras;
    double rows[4], all[4];
    rec_job_sum(t->j, cameras, S_A, rows);
    rec_job_sum(t->j, cameras + rec_job_chunks(t->j), S_A, all);
    for (int l = 0; l < 4; l++)
        out[l] = rows[l] + (double)t->lambda * (all[l] - rows[l]);
}

/* alpha, s, t of one iteration; false: no lane can move any more. */
static bool line_search(struct pcg *t, const double gamma[4])
{
    struct rec_job *j = t->j;
    pvx_pool *pool = j->a->pool;
    size_t cameras = j->a->S->n_cameras, chunks = rec_job_chunks(j);
    double slope[4], curve[4], clips[4];

    for (int l = 0; l < 4; l++)
        t->mu[l] = 1;
    pvx_pool_run(pool, chunks, direction_chunk, t);
    rec_job_sum(j, chunks, S_A, slope);
    bool again = false;
    double keep[4];
    for (int l = 0; l < 4; l++) {
        bool restart = t->beta[l] != 0 && slope[l] >= -1e-3 * gamma[l];
        again = again || restart;
        keep[l] = restart ? 0 : 1;
    }
    if (again) { /* d = keep d - (1 - keep) M phi: the other lanes stay as they are */
        for (int l = 0; l < 4; l++) {
            t->beta[l] = keep[l];
            t->mu[l] = 1 - keep[l];
        }
        pvx_pool_run(pool, chunks, direction_chunk, t);
        rec_job_sum(j, chunks, S_A, slope);
    }

    pvx_pool_run(pool, cameras + chunks, forward_task, t);
    curvature(t, curve);
    bool moving = false;
    for (int l = 0; l < 4; l++) {
        double alpha = curve[l] > 0 && slope[l] < 0 ? -slope[l] / curve[l] : 0;
        t->alpha[l] = isfinite((float)alpha) ? alpha : 0;
        moving = moving || t->alpha[l] > 0;
    }
    if (!moving)
        return false;

    pvx_pool_run(pool, chunks, step_chunk, t);
    rec_job_sum(j, chunks, S_A, slope);
    rec_job_sum(j, chunks, S_B, clips);
    for (int l = 0; l < 4; l++) {
        t->t[l] = 1;
        t->on_q[l] = t->alpha[l];
    }
    if (total(clips) == 0)
        return true;
    pvx_pool_run(pool, cameras + chunks, clipped_task, t);
    curvature(t, curve);
    for (int l = 0; l < 4; l++) {
        t->on_q[l] = 1; /* q is A s now */
        if (clips[l] == 0)
            continue;
        double best = curve[l] > 0 && slope[l] < 0 ? -slope[l] / curve[l] : 0;
        t->t[l] = t->on_q[l] = best < 1 ? best : 1;
    }
    return true;
}

void rec_solve_pcg(struct rec_job *j)
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    struct pcg t = {.j = j, .x = j->x, .phi = s->xv[0], .phi_old = s->xv[1], .d = s->xv[2],
                    .s = s->xv[3], .e = s->xv[4], .prev = s->xv[5], .r = s->yv[0], .q = s->yv[1]};
    size_t cameras = a->S->n_cameras, chunks = rec_job_chunks(j);
    uint32_t limit = j->p->iterations > 0 ? j->p->iterations : DEFAULT_ITERATIONS;
    const struct rec_grid *g = &a->S->grid;
    double h_min = fmin(rec_grid_h(g, 0), fmin(rec_grid_h(g, 1), rec_grid_h(g, 2)));
    for (int i = 0; i < 3; i++)
        t.axis[i] = (float)(h_min * h_min / (rec_grid_h(g, i) * rec_grid_h(g, i)));
    double noise2 = j->p->stop == REC_STOP_DISCREPANCY ? rec_job_noise2(j) : 0;
    double tol = j->p->stop == REC_STOP_AUTO ? 3e-3 : 1e-7;

    pvx_pool_run(a->pool, chunks, neighbours_chunk, &t);
    rec_column_norms(a, s->weight, s->diag, NULL);
    double mean = 0;
    for (int32_t q = 0; q < a->n; q++)
        mean += s->diag[q];
    t.lambda = choose_lambda(j, mean / a->n);
    j->out->lambda = t.lambda;
    pvx_pool_run(a->pool, chunks, precondition_chunk, &t);

    double gamma[4], cross[4], rwr[4], xlx[4], next[4];
    rec_job_residual(j, t.x, t.r, t.q, rwr);
    for (size_t i = 0; i < (size_t)a->n * (size_t)a->cs; i++)
        t.d[i] = t.phi_old[i] = 0;
    pvx_pool_run(a->pool, chunks, gradient_chunk, &t);
    rec_job_sum(j, chunks, S_A, gamma);
    rec_job_sum(j, chunks, S_C, xlx);
    double f = objective(&t, rwr, xlx);
    j->out->objective = f;
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
        pvx_pool_run(a->pool, cameras + chunks, update_task, &t);
        rec_job_sum(j, cameras, S_A, rwr);
        float *swap = t.phi;
        t.phi = t.phi_old;
        t.phi_old = swap;
        pvx_pool_run(a->pool, chunks, gradient_chunk, &t);
        rec_job_sum(j, chunks, S_A, next);
        rec_job_sum(j, chunks, S_B, cross);
        rec_job_sum(j, chunks, S_C, xlx);
        for (int l = 0; l < 4; l++) {
            double beta = gamma[l] > 0 ? (next[l] - cross[l]) / gamma[l] : 0;
            t.beta[l] = beta > 0 && isfinite((float)beta) ? beta : 0;
            gamma[l] = next[l];
        }
        double now = objective(&t, rwr, xlx), gain = f - now;
        f = now;
        j->out->objective = f;
        j->out->iterations = j->out->best = k;
        if (j->trace != NULL)
            j->trace(j->trace_ctx, k, t.x, f, sqrt(total(rwr)));
        if (gain <= tol * f || (noise2 > 0 && total(rwr) <= noise2)) {
            j->out->status = REC_CONVERGED;
            break;
        }
    }
}
