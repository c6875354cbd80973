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
 * CG.  Where it clips, A s = alpha A (d + e), e = s/alpha - d, which is not 0 in the clipped columns
 * alone: few, so their columns are added to A d (many: A s is formed anew).  Lx follows x by the same
 * sums.  When s is no descent direction the lane restarts
 * from -M phi.  alpha, beta, t are per channel.
 * Source: CG (Hestenes & Stiefel, J. Res. NBS 49:409, 1952) with Polak-Ribiere restarts inside
 * Bertsekas' projection of the free variables (SIAM J. Control Optim. 20(2):221, 1982); the
 * arrangement is our own. */
#include <math.h>
#include <string.h>

#include "recon/lanes.h"
#include "recon/solve_impl.h"

#define DEFAULT_ITERATIONS 30
#define BEYOND             6

enum { S_A, S_B, S_C, S_D };

struct pcg {
    struct rec_job *j;
    float *x, *phi, *phi_old, *d, *s, *m, *lx, *lv, *prev; /* x space; lv = L d or L s */
    float *r, *q;                                          /* row space */
    double alpha[4], beta[4], mu[4], t[4], on_q[4];
    double lambda[4];
    float axis[3];
    const float *along; /* d or s, for curvature_task */
    bool product;       /* whether curvature_task has to form q = A along */
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
#pragma GCC unroll 3
    for (int f = 0; f < 6; f += 2)
        out += rec_splat(t->axis[f / 2]) *
               ((at - rec_ld(v, (size_t)nb[f], cs)) + (at - rec_ld(v, (size_t)nb[f + 1], cs)));
    return out;
}

REC_INLINE void precondition(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 lambda = rec_coef(t->lambda), zero = {0}, one = rec_splat(1);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        float degree = 0;
        for (int f = 0; f < 6; f++)
            degree += t->j->s->nbr[i][f] != (int32_t)i ? t->axis[f / 2] : 0;
        rec_f4 h = rec_splat(t->j->s->diag[i]) + lambda * rec_splat(degree);
        rec_st(t->m, i, cs, rec_select(h > 0, one / h, zero));
        rec_st(t->d, i, cs, zero);
        rec_st(t->phi_old, i, cs, zero);
        rec_st(t->lx, i, cs, laplace(t, t->x, i, cs));
    }
}
static void precondition_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? precondition(t, k, 4) : precondition(t, k, 1);
}

/* ---- passes -------------------------------------------------------------------------------------*/

REC_INLINE void direction(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 beta = rec_coef(t->beta), mu = rec_coef(t->mu), zero = {0};
    rec_d4 sum = {{0}, {0}};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 phi = rec_ld(t->phi, i, cs), x = rec_ld(t->x, i, cs);
        rec_f4 d = beta * rec_ld(t->d, i, cs) - mu * rec_ld(t->m, i, cs) * phi;
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

/* lv = L v on one chunk of columns and v'lv. */
REC_INLINE void roughness(struct pcg *t, const float *v, size_t k, size_t cs, double out[4])
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_d4 sum = {{0}, {0}};
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 lap = laplace(t, v, i, cs);
        rec_st(t->lv, i, cs, lap);
        rec_add_product(&sum, lap, rec_ld(v, i, cs));
    }
    rec_put(out, &sum);
}

/* q = A v on one chunk of rows, or q as it is, and its q'Wq. */
REC_INLINE void forward(struct pcg *t, const float *v, size_t k, size_t cs, double out[4])
{
    int32_t i0, i1;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    rec_d4 sum = {{0}, {0}};
    if (t->product)
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

/* s of (5); it is formed again where it is needed, which costs less than to keep it. */
REC_INLINE rec_f4 clipped_step(rec_f4 x, rec_f4 full, rec_i4 *clip)
{
    *clip = x + full < 0;
    return rec_select(*clip, -x, full);
}

/* phi's, how many entries were clipped and in which columns. */
REC_INLINE void step(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 alpha = rec_coef(t->alpha);
    rec_d4 sum = {{0}, {0}};
    rec_i4 clips = {0}, clip;
    int32_t n = 0, *clipped = t->j->s->clipped + q0;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 s = clipped_step(rec_ld(t->x, i, cs), alpha * rec_ld(t->d, i, cs), &clip);
        clips -= clip;
        clipped[n] = (int32_t)i;
        n += (clip[0] | clip[1] | clip[2] | clip[3]) != 0;
        rec_add_product(&sum, s, rec_ld(t->phi, i, cs));
    }
    rec_put(t->j->s->part[k][S_A], &sum);
    for (int l = 0; l < 4; l++)
        t->j->s->part[k][S_B][l] = clips[l];
    t->j->s->n_clipped[k] = n;
}
static void step_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? step(t, k, 4) : step(t, k, 1);
}

/* s itself, for curvature_task. */
REC_INLINE void store_step(struct pcg *t, size_t k, size_t cs)
{
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    rec_f4 alpha = rec_coef(t->alpha);
    rec_i4 clip;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        rec_st(t->s, i, cs, clipped_step(rec_ld(t->x, i, cs), alpha * rec_ld(t->d, i, cs), &clip));
}
static void store_step_chunk(void *ctx, size_t k)
{
    struct pcg *t = ctx;
    t->j->a->cs == 4 ? store_step(t, k, 4) : store_step(t, k, 1);
}

/* With e = s/alpha - d, which is 0 but in the few clipped columns: q += A e, lv += L e, so that they
 * are A s / alpha and L s / alpha; slv = e'Ld + e'L(d+e), what s'Ls / alpha^2 exceeds d'Ld by.  The
 * values of e are kept in t->s, one after the other.  Serial: the order of the sums is fixed. */
REC_INLINE void add_clipped(struct pcg *t, size_t cs, double slv[4])
{
    const struct rec_gather *g = &t->j->a->by_col;
    const int32_t *clipped = t->j->s->clipped;
    rec_f4 alpha = rec_coef(t->alpha), inverse = {0}, zero = {0};
    rec_d4 sum = {{0}, {0}};
    size_t chunks = rec_job_chunks(t->j), n = 0;
    int32_t q0, q1;
    for (int l = 0; l < 4; l++)
        inverse[l] = t->alpha[l] > 0 ? (float)(1 / t->alpha[l]) : 0;
    for (size_t k = 0; k < chunks; k++) {
        rec_chunk_range(t->j->a->n, k, &q0, &q1);
        for (int32_t i = 0; i < t->j->s->n_clipped[k]; i++, n++) {
            size_t c = (size_t)clipped[q0 + i];
            rec_f4 x = rec_ld(t->x, c, cs), d = rec_ld(t->d, c, cs);
            rec_f4 e = rec_select(x + alpha * d < 0, -x * inverse - d, zero);
            rec_st(t->s, n, cs, e);
            rec_add_product(&sum, e, rec_ld(t->lv, c, cs));
        }
    }
    n = 0;
    for (size_t k = 0; k < chunks; k++) {
        rec_chunk_range(t->j->a->n, k, &q0, &q1);
        for (int32_t i = 0; i < t->j->s->n_clipped[k]; i++, n++) {
            size_t c = (size_t)clipped[q0 + i];
            rec_f4 e = rec_ld(t->s, n, cs);
            for (int f = 0; f < 6; f++) {
                size_t nb = (size_t)t->j->s->nbr[c][f];
                rec_f4 we = rec_splat(t->axis[f / 2]) * e;
                rec_st(t->lv, c, cs, rec_ld(t->lv, c, cs) + we);
                rec_st(t->lv, nb, cs, rec_ld(t->lv, nb, cs) - we);
            }
            for (uint32_t at = g->ptr[c]; at < g->ptr[c + 1]; at++) {
                size_t row = g->entry[at].idx;
                rec_st(t->q, row, cs, rec_ld(t->q, row, cs) + rec_splat(g->entry[at].val) * e);
            }
        }
    }
    n = 0;
    for (size_t k = 0; k < chunks; k++) {
        rec_chunk_range(t->j->a->n, k, &q0, &q1);
        for (int32_t i = 0; i < t->j->s->n_clipped[k]; i++, n++)
            rec_add_product(&sum, rec_ld(t->s, n, cs), rec_ld(t->lv, (size_t)clipped[q0 + i], cs));
    }
    rec_put(slv, &sum);
}

/* Rows: r += on_q q, r'Wr, q = W r for the adjoint.  Columns: x += t s, Lx += on_q lv. */
REC_INLINE void update_rows(struct pcg *t, size_t k, size_t cs)
{
    int32_t i0, i1;
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    rec_f4 on_q = rec_coef(t->on_q);
    rec_d4 sum = {{0}, {0}};
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
    rec_f4 on_s = rec_coef(t->t), on_lv = rec_coef(t->on_q), alpha = rec_coef(t->alpha);
    rec_f4 zero = {0};
    rec_i4 clip;
    size_t o0 = (size_t)q0 * cs, o1 = (size_t)q1 * cs;
    if (t->keep_prev)
        memcpy(t->prev + o0, t->x + o0, (o1 - o0) * sizeof *t->x);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 x = rec_ld(t->x, i, cs);
        x += on_s * clipped_step(x, alpha * rec_ld(t->d, i, cs), &clip);
        rec_st(t->x, i, cs, rec_select(x > 0, x, zero));
        rec_st(t->lx, i, cs, rec_ld(t->lx, i, cs) + on_lv * rec_ld(t->lv, i, cs));
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
    rec_f4 lambda = rec_coef(t->lambda), zero = {0};
    rec_d4 sum[4] = {{{0}, {0}}};
    rec_adjoint_range(t->j->a, t->q, q0, q1, t->phi);
    for (size_t i = (size_t)q0; i < (size_t)q1; i++) {
        rec_f4 lap = rec_ld(t->lx, i, cs), x = rec_ld(t->x, i, cs);
        rec_f4 g = rec_ld(t->phi, i, cs) + lambda * lap;
        g = rec_select((x > 0) | (g < 0), g, zero);
        rec_st(t->phi, i, cs, g);
        rec_f4 mg = rec_ld(t->m, i, cs) * g;
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
    double f = 0;
    for (int l = 0; l < 4; l++)
        f += 0.5 * rwr[l] + 0.5 * t->lambda[l] * xlx[l];
    return f;
}

/* lambda in units of the mean diagonal of A'WA.  Theory gives sigma^2 / var(D x); that variance is not
 * known, but what it hangs on is: the mean brightness of a ray, sum(b)/rows, and the mean chord of a
 * ray in voxels, K (the finer the voxels, the less neighbours differ).  The power law was fitted to
 * the best lambda of 64 cases (two flames, 32..96 voxels a side, images 80..320 wide, 1..2 rays per
 * bin, 6..12 cameras, noise 0.2..2 %), where it is right to a factor 1.5; the error changes by under
 * 3 % within a factor 2.  The floor stands for what noise does not explain: the basis. */
#define LAMBDA_FLOOR   0.1
#define LAMBDA_CEILING 20.0
#define LAMBDA_UNKNOWN 0.5 /* when sigma is not known */
static void auto_lambda(const struct rec_job *j, double chord, double rel[4])
{
    const struct rec_grid *g = &j->a->S->grid;
    double rows = j->a->rows;
    double h = cbrt(rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2));
    double voxels = pow(chord / rows / h, 2.59);
    for (int l = 0; l < 4; l++) {
        double noise = j->light[l] > 0 ? j->sigma * rows / j->light[l] : 1;
        double v = LAMBDA_FLOOR + 0.026 * pow(noise, 1.78) * voxels;
        rel[l] = j->sigma > 0    ? fmin(v, LAMBDA_CEILING)
                 : j->sigma == 0 ? LAMBDA_FLOOR
                                 : LAMBDA_UNKNOWN;
    }
}

/* q'Wq and v'Lv per lane, after forming q = A v and lv = L v; v NULL: q'Wq of q as it is alone. */
static void curvature(struct pcg *t, const float *v, double qwq[4], double vlv[4])
{
    size_t rows = rec_job_row_chunks(t->j), all = rows + rec_job_chunks(t->j);
    t->along = v;
    t->product = v != NULL;
    pvx_pool_run(t->j->a->pool, v != NULL ? all : rows, curvature_task, t);
    rec_job_sum(t->j, 0, rows, S_A, qwq);
    if (v != NULL)
        rec_job_sum(t->j, rows, all, S_A, vlv);
}

/* alpha, s, t of one iteration; false: no lane can move any more. */
static bool line_search(struct pcg *t, const double gamma[4])
{
    struct rec_job *j = t->j;
    pvx_pool *pool = j->a->pool;
    size_t chunks = rec_job_chunks(j);
    double slope[4], clips[4], qwq[4], vlv[4], more[4];

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

    curvature(t, t->d, qwq, vlv);
    bool moving = false;
    for (int l = 0; l < 4; l++) {
        double curve = qwq[l] + t->lambda[l] * vlv[l];
        double alpha = curve > 0 && slope[l] < 0 ? -slope[l] / curve : 0;
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
    int64_t columns = 0;
    for (size_t k = 0; k < chunks; k++)
        columns += j->s->n_clipped[k];
    bool few = columns < j->a->n / 8;
    if (few) {
        j->a->cs == 4 ? add_clipped(t, 4, more) : add_clipped(t, 1, more);
        curvature(t, NULL, qwq, NULL);
    } else {
        pvx_pool_run(pool, chunks, store_step_chunk, t);
        curvature(t, t->s, qwq, vlv);
    }
    for (int l = 0; l < 4; l++) {
        double unit = few ? t->alpha[l] : 1; /* q is A s / unit, lv is L s / unit */
        double curve = qwq[l] + t->lambda[l] * (few ? vlv[l] + more[l] : vlv[l]);
        curve *= unit * unit;
        double best = curve > 0 && slope[l] < 0 ? -slope[l] / curve : 0;
        if (clips[l] > 0)
            t->t[l] = best < 1 ? best : 1;
        t->on_q[l] = t->t[l] * unit; /* of lv too */
    }
    return true;
}

void rec_solve_pcg(struct rec_job *j)
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    struct pcg t = {.j = j,
                    .x = j->x,
                    .phi = s->xv[0],
                    .phi_old = s->xv[1],
                    .d = s->xv[2],
                    .s = s->xv[3],
                    .m = s->xv[4],
                    .lx = s->xv[5],
                    .lv = s->xv[6],
                    .prev = s->xv[7],
                    .r = s->yv[0],
                    .q = s->yv[1]};
    size_t rows = rec_job_row_chunks(j), chunks = rec_job_chunks(j);
    uint32_t limit = j->p->iterations > 0 ? j->p->iterations : DEFAULT_ITERATIONS;
    const struct rec_grid *g = &a->S->grid;
    double h_min = fmin(rec_grid_h(g, 0), fmin(rec_grid_h(g, 1), rec_grid_h(g, 2)));
    for (int i = 0; i < 3; i++)
        t.axis[i] = (float)(h_min * h_min / (rec_grid_h(g, i) * rec_grid_h(g, i)));
    bool corner = j->p->stop == REC_STOP_LCURVE;
    struct rec_lcurve curve = {0};
    double best_f = 0;
    float *best = s->xv[8];
    double noise2 = j->p->stop == REC_STOP_DISCREPANCY ? rec_job_noise2(j) : 0;
    double tol = j->p->stop == REC_STOP_AUTO ? 5e-4 : 1e-7;

    t.keep_prev = corner;
    pvx_pool_run(a->pool, chunks, neighbours_chunk, &t);
    rec_column_norms(a, s->weight, s->diag, t.s); /* t.s: column sums, for a moment */
    double mean = 0, chord = 0;
    for (int32_t q = 0; q < a->n; q++) {
        mean += s->diag[q] / a->n;
        chord += t.s[q];
    }
    if (j->p->lambda < 0)
        auto_lambda(j, chord, t.lambda);
    for (int l = 0; l < 4; l++) {
        t.lambda[l] = mean * (j->p->lambda < 0 ? t.lambda[l] : (double)j->p->lambda);
        j->out->lambda += l < s->nch ? t.lambda[l] / s->nch : 0;
    }
    pvx_pool_run(a->pool, chunks, precondition_chunk, &t);

    double gamma[4], cross[4], rwr[4], xlx[4], next[4];
    rec_job_residual(j, t.x, t.r, t.q, rwr);
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
        if (corner) {
            double norm[4];
            rec_job_sum(j, 0, chunks, S_D, norm);
            if (rec_lcurve_add(&curve, k, sqrt(total(rwr)), sqrt(total(norm)))) {
                rec_job_copy(j, best, t.prev);
                best_f = now + gain; /* of the iterate before */
            }
            if (rec_lcurve_done(&curve, k, BEYOND)) {
                j->out->status = REC_CONVERGED;
                break;
            }
        }
        if (gain <= tol * f || (noise2 > 0 && total(rwr) <= noise2)) {
            j->out->status = REC_CONVERGED;
            break;
        }
    }
    if (corner && curve.best_k > 0) {
        rec_job_copy(j, t.x, best);
        j->out->best = curve.best_k;
        j->out->objective = best_f;
    }
}
