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
 * CG.  Where it clips, A s is formed.  When s is no descent direction the lane restarts
 * from -M phi.  alpha, beta, t are per channel.
 * Source: CG (Hestenes & Stiefel, J. Res. NBS 49:409, 1952) with Polak-Ribiere restarts inside
 * Bertsekas' projection of the free variables (SIAM J. Control Optim. 20(2):221, 1982); the
 * arrangement is our own. */
#include <math.h>
#include <string.h>

#include "recon/lanes.h"
#include "recon/solve_impl.h"

#define DEFAULT_ITERATIONS 30
#define BEYOND 6

enum { S_A, S_B, S_C, S_D };

struct pcg {
    struct rec_job *j;
    float *x, *phi, *phi_old, *d, *s, *prev; /* x space */
    float *r, *q;                            /* row space */
    double alpha[4], beta[4], mu[4], t[4], on_q[4];
    float lambda;
    float axis[3];
    const float *along; /* d or s, for curvature_task */
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
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
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

/* (L v) at q.  A missing neighbour is q itself: no difference, no penalty. */
REC_INLINE rec_f4 laplace(const struct pcg *t, const float *v, size_t q, size_t cs)
{
    const int32_t *nb = t->j->s->nbr[q];
    rec_f4 at = rec_ld(v, q, cs), out = {0};
    for (int f = 0; f < 6; f += 2)
        out += rec_splat(t->axis[f / 2]) * ((at - rec_ld(v, (size_t)nb[f], cs)) +
                                            (at - rec_ld(v, (size_t)nb[f + 1], cs)));
    return out;
}

static void precondition_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    float *diag = t->j->s->diag;
    for (int32_t q = q0; q < q1; q++) {
        float h = diag[q];
        for (int f = 0; f < 6; f++)
            h += t->j->s->nbr[q][f] != q ? t->lambda * t->axis[f / 2] : 0;
        diag[q] = h > 0 ? 1 / h : 0;
    }
}

/* ---- passes -------------------------------------------------------------------------------------*/

REC_INLINE void direction(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    const float *m = t->j->s->diag;
    rec_f4 beta = rec_coef(t->beta), mu = rec_coef(t->mu), zero = {0};
    rec_d4 sum = {0};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 phi = rec_ld(t->phi, i, cs), x = rec_ld(t->x, i, cs);
        rec_f4 d = beta * rec_ld(t->d, i, cs) - mu * rec_splat(m[i]) * phi;
        d = rec_select((x > 0) | (phi < 0), d, zero);
        rec_st(t->d, i, cs, d);
        rec_add_product(&sum, d, phi);
    }
    rec_put(t->j->s->part[k][S_A], &sum);
}
static void direction_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? direction(t, k, 4) : direction(t, k, 1);
}

/* v'Lv of one chunk. */
REC_INLINE void roughness(struct pcg *t, const float *v, size_t k, size_t cs, double out[4])
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_d4 sum = {0};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        rec_add_product(&sum, laplace(t, v, i, cs), rec_ld(v, i, cs));
    rec_put(out, &sum);
}

/* q = A v on one chunk of rows and its q'Wq. */
REC_INLINE void forward(struct pcg *t, const float *v, size_t k, size_t cs, double out[4])
{
    int32_t i0, i1;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    rec_d4 sum = {0};
    rec_forward_range(t->j->a, v, i0, i1, t->q);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        rec_f4 q = rec_ld(t->q, i, cs);
        rec_add_product(&sum, rec_splat(t->j->w[i]) * q, q);
    }
    rec_put(out, &sum);
}

/* What v'Hv is made of, v = d or s.  Rows: q = A v, q'Wq.  Columns: v'Lv. */
static void curvature_task(void *ctx, size_t i)
{
    struct pcg *t = ctx;
    size_t rows = rec_job_row_chunks(t->j);
    double *out = t->j->s->part[i][S_A];
    if (t->j->a->cs == 4)
        i < rows ? forward(t, t->along, i, 4, out) : roughness(t, t->along, i - rows, 4, out);
    else
        i < rows ? forward(t, t->along, i, 1, out) : roughness(t, t->along, i - rows, 1, out);
}

/* s by (5), phi's, and how many entries were clipped. */
REC_INLINE void step(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 alpha = rec_coef(t->alpha);
    rec_d4 sum = {0};
    rec_i4 clips = {0};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs), full = alpha * rec_ld(t->d, i, cs);
        rec_i4 clip = x + full < 0;
        rec_f4 s = rec_select(clip, -x, full);
        clips -= clip;
        rec_st(t->s, i, cs, s);
        rec_add_product(&sum, s, rec_ld(t->phi, i, cs));
    }
    rec_put(t->j->s->part[k][S_A], &sum);
    for (int l = 0; l < 4; l++)
        t->j->s->part[k][S_B][l] = clips[l];
}
static void step_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? step(t, k, 4) : step(t, k, 1);
}

/* Rows: r += on_q q, r'Wr, q = W r for the adjoint.  Columns: x += t s. */
REC_INLINE void update_rows(struct pcg *t, size_t k, size_t cs)
{
    int32_t i0, i1;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    rec_f4 on_q = rec_coef(t->on_q);
    rec_d4 sum = {0};
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        rec_f4 r = rec_ld(t->r, i, cs) + on_q * rec_ld(t->q, i, cs);
        rec_f4 wr = rec_splat(t->j->w[i]) * r;
        rec_st(t->r, i, cs, r);
        rec_st(t->q, i, cs, wr);
        rec_add_product(&sum, wr, r);
    }
    rec_put(t->j->s->part[k][S_A], &sum);
}
REC_INLINE void update_columns(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 on_s = rec_coef(t->t), zero = {0};
    size_t o0 = (size_t)q0 * cs, o1 = (size_t)q1 * cs;
    if (t->keep_prev)
        memcpy(t->prev + o0, t->x + o0, (o1 - o0) * sizeof *t->x);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs) + on_s * rec_ld(t->s, i, cs);
        rec_st(t->x, i, cs, rec_select(x > 0, x, zero));
    }
}
static void update_task(void *ctx, size_t i)
{
    struct pcg *t = ctx;
    size_t rows = rec_job_row_chunks(t->j);
    if (t->j->a->cs == 4)
        i < rows ? update_rows(t, i, 4) : update_columns(t, i - rows, 4);
    else
        i < rows ? update_rows(t, i, 1) : update_columns(t, i - rows, 1);
}

/* phi from q = W r and x by (2), (3).  Sums: phi'M phi, phi'M phi_old, x'Lx, x'x. */
REC_INLINE void gradient(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    const float *m = t->j->s->diag;
    rec_f4 lambda = rec_splat(t->lambda), zero = {0};
    rec_d4 sum[4] = {{0}};
    rec_adjoint_range(t->j->a, t->q, q0, q1, t->phi);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 lap = laplace(t, t->x, i, cs), x = rec_ld(t->x, i, cs);
        rec_f4 g = rec_ld(t->phi, i, cs) + lambda * lap;
        g = rec_select((x > 0) | (g < 0), g, zero);
        rec_st(t->phi, i, cs, g);
        rec_f4 mg = rec_splat(m[i]) * g;
        rec_add_product(&sum[S_A], mg, g);
        rec_add_product(&sum[S_B], mg, rec_ld(t->phi_old, i, cs));
        rec_add_product(&sum[S_C], lap, x);
        rec_add_product(&sum[S_D], x, x);
    }
    for (int w = 0; w < 4; w++)
        rec_put(t->j->s->part[k][w], &sum[w]);
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

/* lambda in units of the mean diagonal of A'WA.  Theory gives sigma^2 / var(D x); that variance is not
 * known, but what it hangs on is: the mean brightness of a ray, sum(b)/rows, and the mean chord of a
 * ray in voxels, K (the finer the voxels, the less neighbours differ).  The power law was fitted to
 * the best lambda of 64 cases (two flames, 32..96 voxels a side, images 80..320 wide, 1..2 rays per
 * bin, 6..12 cameras, noise 0.2..2 %), where it is right to a factor 1.5; the error changes by under
 * 3 % within a factor 2.  The floor stands for what noise does not explain: the basis. */
#define LAMBDA_FLOOR 0.1
#define LAMBDA_CEILING 20.0
#define LAMBDA_UNKNOWN 0.5 /* when sigma is not known */
static double auto_lambda(struct rec_job *j)
{
    const struct rec_subsys *a = j->a;
    const struct rec_grid *g = &a->S->grid;
    double light = 0, chord = 0, rows = a->rows;
    if (!(j->sigma > 0))
        return j->sigma == 0 ? LAMBDA_FLOOR : LAMBDA_UNKNOWN;
    for (size_t i = 0; i < (size_t)a->rows; i++)
        for (int l = 0; l < j->s->nch; l++)
            light += j->b[i * (size_t)a->cs + (size_t)l] / j->s->nch;
    for (uint64_t e = 0; e < a->nnz; e++)
        chord += a->by_row.val[e];
    double h = cbrt(rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2));
    double noise = light > 0 ? j->sigma * rows / light : 1, voxels = chord / rows / h;
    double rel = LAMBDA_FLOOR + 0.026 * pow(noise, 1.78) * pow(voxels, 2.59);
    return rel < LAMBDA_CEILING ? rel : LAMBDA_CEILING;
}

/* v'Hv per lane; leaves A v in q. */
static void curvature(struct pcg *t, const float *v, double out[4])
{
    size_t rows = rec_job_row_chunks(t->j), all = rows + rec_job_chunks(t->j);
    double qwq[4], vlv[4];
    t->along = v;
    pvx_pool_run(t->j->a->pool, all, curvature_task, t);
    rec_job_sum(t->j, 0, rows, S_A, qwq);
    rec_job_sum(t->j, rows, all, S_A, vlv);
    for (int l = 0; l < 4; l++)
        out[l] = qwq[l] + (double)t->lambda * vlv[l];
}

/* alpha, s, t of one iteration; false: no lane can move any more. */
static bool line_search(struct pcg *t, const double gamma[4])
{
    struct rec_job *j = t->j;
    pvx_pool *pool = j->a->pool;
    size_t chunks = rec_job_chunks(j);
    double slope[4], curve[4], clips[4];

    for (int l = 0; l < 4; l++)
        t->mu[l] = 1;
    pvx_pool_run(pool, chunks, direction_chunk, t);
    rec_job_sum(j, 0, chunks, S_A, slope);
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
        rec_job_sum(j, 0, chunks, S_A, slope);
    }

    curvature(t, t->d, curve);
    bool moving = false;
    for (int l = 0; l < 4; l++) {
        double alpha = curve[l] > 0 && slope[l] < 0 ? -slope[l] / curve[l] : 0;
        t->alpha[l] = isfinite((float)alpha) ? alpha : 0;
        moving = moving || t->alpha[l] > 0;
    }
    if (!moving)
        return false;

    pvx_pool_run(pool, chunks, step_chunk, t);
    rec_job_sum(j, 0, chunks, S_A, slope);
    rec_job_sum(j, 0, chunks, S_B, clips);
    for (int l = 0; l < 4; l++) {
        t->t[l] = 1;
        t->on_q[l] = t->alpha[l];
    }
    if (total(clips) == 0)
        return true;
    curvature(t, t->s, curve);
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
                    .s = s->xv[3], .prev = s->xv[4], .r = s->yv[0], .q = s->yv[1]};
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
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
    t.lambda = (float)(mean / a->n * (j->p->lambda < 0 ? auto_lambda(j) : j->p->lambda));
    j->out->lambda = t.lambda;
    pvx_pool_run(a->pool, chunks, precondition_chunk, &t);

    double gamma[4], cross[4], rwr[4], xlx[4], next[4];
    rec_job_residual(j, t.x, t.r, t.q, rwr);
    for (size_t i = 0; i < (size_t)a->n * (size_t)a->cs; i++)
        t.d[i] = t.phi_old[i] = 0;
    pvx_pool_run(a->pool, chunks, gradient_chunk, &t);
    rec_job_sum(j, 0, chunks, S_A, gamma);
    rec_job_sum(j, 0, chunks, S_C, xlx);
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
        pvx_pool_run(a->pool, rows + chunks, update_task, &t);
        rec_job_sum(j, 0, rows, S_A, rwr);
        float *swap = t.phi;
        t.phi = t.phi_old;
        t.phi_old = swap;
        pvx_pool_run(a->pool, chunks, gradient_chunk, &t);
        rec_job_sum(j, 0, chunks, S_A, next);
        rec_job_sum(j, 0, chunks, S_B, cross);
        rec_job_sum(j, 0, chunks, S_C, xlx);
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
