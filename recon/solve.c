#include "recon/solve/solve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "recon/solve_impl.h"

const struct rec_solve_params rec_solve_defaults = REC_SOLVE_DEFAULTS;

struct method {
    const char *name;
    void (*run)(struct rec_job *j);
};
static const struct method methods[] = {
    {"pcg", rec_solve_pcg},     {"cgls-paper", rec_solve_cgls_paper},
    {"cgls", rec_solve_cgls},   {"mlem", rec_solve_mlem},
    {"osem", rec_solve_osem},   {"sirt", rec_solve_sirt},
    {"fista", rec_solve_fista}, {"mrnsd", rec_solve_mrnsd}};
#define N_METHODS (sizeof methods / sizeof *methods)

const char *rec_status_name(enum rec_status s)
{
    static const char *const name[] = {"converged", "max-iter", "deadline", "stagnated", "empty"};
    return (size_t)s < sizeof name / sizeof *name ? name[s] : "unknown";
}

const char *const *rec_solver_names(void)
{
    static const char *const names[] = {"pcg",  "cgls-paper", "cgls",  "mlem", "osem",
                                        "sirt", "fista",      "mrnsd", NULL};
    return names;
}

bool rec_solver_is_default(const char *name)
{
    return name == NULL || *name == '\0' || strcmp(name, methods[0].name) == 0;
}

pvx_err rec_solver_new(const rec_sysmat *S, int nch, rec_solver **out)
{
    *out = NULL;
    if (nch != 1 && nch != 3)
        return PVX_EINVAL;
    rec_solver *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return PVX_ENOMEM;
    size_t row0[REC_MAX_CAMERAS + 1];
    s->S = S;
    s->nch = nch;
    s->cs = nch == 3 ? 4 : 1;
    s->n_max = rec_grid_count(&S->grid);
    s->rows_max = rec_rowspace(S, row0);
    bool ok = true;
    for (int i = 0; i < N_XVEC; i++)
        ok = (s->xv[i] = pvx_reserve(s->n_max * (size_t)s->cs * sizeof(float))) != NULL && ok;
    for (int i = 0; i < N_YVEC; i++)
        ok = (s->yv[i] = pvx_reserve(s->rows_max * (size_t)s->cs * sizeof(float))) != NULL && ok;
    s->b = pvx_reserve(s->rows_max * (size_t)s->cs * sizeof *s->b);
    s->weight = pvx_reserve(s->rows_max * sizeof *s->weight);
    s->weight4 = pvx_reserve(s->rows_max * 4 * sizeof *s->weight4);
    s->diag = pvx_reserve(s->n_max * sizeof *s->diag);
    s->near = pvx_reserve(s->n_max * sizeof *s->near);
    s->piece = pvx_reserve(s->n_max * sizeof *s->piece);
    s->stiff = pvx_reserve(s->n_max * sizeof *s->stiff);
    s->clipped = pvx_reserve(s->n_max * sizeof *s->clipped);
    if (!ok || s->b == NULL || s->weight == NULL || s->weight4 == NULL || s->diag == NULL ||
        s->near == NULL || s->stiff == NULL || s->piece == NULL || s->clipped == NULL) {
        rec_solver_free(&s);
        return PVX_ENOMEM;
    }
    *out = s;
    return PVX_OK;
}

void rec_solver_free(rec_solver **sp)
{
    rec_solver *s = *sp;
    if (s == NULL)
        return;
    for (int i = 0; i < N_XVEC; i++)
        pvx_unreserve(s->xv[i], s->n_max * (size_t)s->cs * sizeof(float));
    for (int i = 0; i < N_YVEC; i++)
        pvx_unreserve(s->yv[i], s->rows_max * (size_t)s->cs * sizeof(float));
    pvx_unreserve(s->b, s->rows_max * (size_t)s->cs * sizeof *s->b);
    pvx_unreserve(s->weight, s->rows_max * sizeof *s->weight);
    pvx_unreserve(s->weight4, s->rows_max * 4 * sizeof *s->weight4);
    pvx_unreserve(s->diag, s->n_max * sizeof *s->diag);
    pvx_unreserve(s->near, s->n_max * sizeof *s->near);
    pvx_unreserve(s->piece, s->n_max * sizeof *s->piece);
    pvx_unreserve(s->stiff, s->n_max * sizeof *s->stiff);
    pvx_unreserve(s->clipped, s->n_max * sizeof *s->clipped);
    free(s);
    *sp = NULL;
}

void rec_job_sum(const struct rec_job *j, size_t from, size_t to, int what, double out[4])
{
    for (int l = 0; l < 4; l++) {
        double s = 0;
        for (size_t k = from; k < to; k++)
            s += j->s->part[k][what][l];
        out[l] = s;
    }
}

bool rec_job_late(const struct rec_job *j)
{
    return j->p->deadline_ns != 0 && pvx_now_mono() >= j->p->deadline_ns;
}

double rec_job_noise2(const struct rec_job *j)
{
    return j->sigma > 0 ? j->sigma * j->sigma * j->m : 0;
}

double rec_job_norm_x(struct rec_job *j, const float *v)
{
    double d[4];
    rec_dot(j->a, j->a->n, v, v, d);
    return sqrt(rec_lanes_total(d));
}

struct copy {
    const struct rec_job *j;
    float *dst;
    const float *src;
};
static void copy_chunk(void *ctx, size_t k)
{
    struct copy *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->j->a->cs, o = (size_t)q0 * cs;
    memcpy(t->dst + o, t->src + o, (size_t)(q1 - q0) * cs * sizeof *t->dst);
}
void rec_job_copy(struct rec_job *j, float *dst, const float *src)
{
    struct copy t = {j, dst, src};
    pvx_pool_run(j->a->pool, rec_job_chunks(j), copy_chunk, &t);
}

struct residual {
    struct rec_job *j;
    const float *x;
    float *r, *wr;
    float scale[4];
};
/* Weight of row i in lane l. */
static inline float weight_of(const struct rec_job *j, size_t i, size_t l)
{
    return j->w4 == NULL ? j->w[i] : j->w4[i * 4 + l];
}
/* r, wr at one value; what it adds to r'Wr. */
static inline double set_residual(struct residual *t, size_t at, float w, float r)
{
    t->r[at] = r;
    t->wr[at] = w * r;
    return (double)t->wr[at] * r;
}
static void residual_chunk(void *ctx, size_t k)
{
    struct residual *t = ctx;
    const struct rec_subsys *a = t->j->a;
    size_t cs = (size_t)a->cs;
    int32_t i0, i1;
    double s[4] = {0};
    rec_chunk_range(a->rows, k, &i0, &i1);
    rec_forward_range(a, t->x, i0, i1, t->r);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (size_t l = 0; l < cs; l++)
            s[l] += set_residual(t, i * cs + l, weight_of(t->j, i, l),
                                 t->r[i * cs + l] - t->j->b[i * cs + l]);
    memcpy(t->j->s->part[k][0], s, sizeof s);
}
void rec_job_residual(struct rec_job *j, const float *x, float *r, float *wr, double out[4])
{
    struct residual t = {.j = j, .x = x, .r = r, .wr = wr};
    pvx_pool_run(j->a->pool, rec_job_row_chunks(j), residual_chunk, &t);
    rec_job_sum(j, 0, rec_job_row_chunks(j), 0, out);
}

/* A start that fits worse than nothing must not come out at a deadline: each lane of it is scaled to
 * the best fit along its ray,  alpha = max(0, (A x)'W b / (A x)'W (A x)),  so that the residual never
 * exceeds ||b|| and an old flame of another brightness costs no iterations. */
static void fit_chunk(void *ctx, size_t k)
{
    struct residual *t = ctx;
    const struct rec_subsys *a = t->j->a;
    size_t cs = (size_t)a->cs;
    int32_t i0, i1;
    double fit[4] = {0}, size[4] = {0};
    rec_chunk_range(a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (size_t l = 0; l < cs; l++) {
            double b = t->j->b[i * cs + l], ax = (double)t->r[i * cs + l] + b;
            double w = weight_of(t->j, i, l);
            fit[l] += w * ax * b;
            size[l] += w * ax * ax;
        }
    memcpy(t->j->s->part[k][0], fit, sizeof fit);
    memcpy(t->j->s->part[k][1], size, sizeof size);
}
/* Columns: x = alpha x.  Rows: r = alpha (r + b) - b, wr, r'Wr. */
static void scale_task(void *ctx, size_t i)
{
    struct residual *t = ctx;
    const struct rec_subsys *a = t->j->a;
    size_t cs = (size_t)a->cs, rows = rec_job_row_chunks(t->j);
    int32_t i0, i1;
    double s[4] = {0};
    if (i >= rows) {
        rec_chunk_range(a->n, i - rows, &i0, &i1);
        for (size_t q = (size_t)i0; q < (size_t)i1; q++)
            for (size_t l = 0; l < cs; l++)
                t->j->x[q * cs + l] *= t->scale[l];
        return;
    }
    rec_chunk_range(a->rows, i, &i0, &i1);
    for (size_t k = (size_t)i0; k < (size_t)i1; k++)
        for (size_t l = 0; l < cs; l++) {
            float b = t->j->b[k * cs + l], r = t->scale[l] * (t->r[k * cs + l] + b) - b;
            s[l] += set_residual(t, k * cs + l, weight_of(t->j, k, l), r);
        }
    memcpy(t->j->s->part[i][0], s, sizeof s);
}
static void scale_start(struct rec_job *j)
{
    size_t chunks = rec_job_row_chunks(j);
    struct residual t = {.j = j, .x = j->x, .r = j->s->yv[0], .wr = j->s->yv[1]};
    double fit[4], size[4];
    rec_job_residual(j, j->x, t.r, t.wr, fit);
    pvx_pool_run(j->a->pool, chunks, fit_chunk, &t);
    rec_job_sum(j, 0, chunks, 0, fit);
    rec_job_sum(j, 0, chunks, 1, size);
    for (int l = 0; l < 4; l++) {
        t.scale[l] = size[l] > 0 && fit[l] > 0 ? (float)(fit[l] / size[l]) : 0;
        if (!isfinite(t.scale[l]))
            t.scale[l] = 0;
    }
    pvx_pool_run(j->a->pool, chunks + rec_job_chunks(j), scale_task, &t);
    rec_job_sum(j, 0, chunks, 0, j->start_rwr);
    j->scaled = true;
}

static void zero_chunk(void *ctx, size_t k)
{
    struct residual *t = ctx;
    size_t cs = (size_t)t->j->a->cs;
    int32_t i0, i1;
    double s[4] = {0};
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (size_t l = 0; l < cs; l++)
            s[l] += set_residual(t, i * cs + l, weight_of(t->j, i, l), -t->j->b[i * cs + l]);
    memcpy(t->j->s->part[k][0], s, sizeof s);
}

void rec_job_start(struct rec_job *j, double out[4])
{
    struct residual t = {.j = j, .r = j->s->yv[0], .wr = j->s->yv[1]};
    if (j->scaled) {
        memcpy(out, j->start_rwr, sizeof j->start_rwr);
    } else if (j->zero) {
        pvx_pool_run(j->a->pool, rec_job_row_chunks(j), zero_chunk, &t);
        rec_job_sum(j, 0, rec_job_row_chunks(j), 0, out);
    } else {
        rec_job_residual(j, j->x, t.r, t.wr, out);
    }
}

/* Weight of A's row i from the image's: that of all channels, or of each and the most of them. */
static float take_weight(struct rec_job *j, size_t i, double measured[4], double sum[4])
{
    size_t ray = j->a->ray[i];
    if (j->w4 == NULL)
        return j->image_weight[ray];
    const float *w = j->image_weight + ray * 4;
    float most = 0;
    for (size_t l = 0; l < 3; l++) {
        j->s->weight4[i * 4 + l] = w[l];
        measured[l] += w[l] > 0;
        sum[l] += (double)w[l];
        most = w[l] > most ? w[l] : most;
    }
    j->s->weight4[i * 4 + 3] = 0;
    sum[3] += (double)most;
    return most;
}

/* b and w on A's rows, ||W^(1/2) b||^2, the number of measured rows, sum of w b per lane. */
static void prepare_chunk(void *ctx, size_t k)
{
    struct rec_job *j = ctx;
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    size_t cs = (size_t)a->cs;
    int32_t i0, i1;
    double norm = 0, rows = 0, ones = 0, light[4] = {0}, measured[4] = {0}, sum[4] = {0};
    rec_chunk_range(a->rows, k, &i0, &i1);
    for (int32_t i = i0; i < i1; i++) {
        float w = take_weight(j, (size_t)i, measured, sum);
        s->weight[i] = w;
        rows += w > 0;
        ones += w == 1;
        for (size_t l = 0; l < cs; l++) {
            float b = j->image[(size_t)a->ray[i] * cs + l], wl = weight_of(j, (size_t)i, l);
            s->b[(size_t)i * cs + l] = b;
            norm += (double)wl * b * b;
            light[l] += (double)wl * b;
        }
    }
    memset(s->part[k][0], 0, sizeof s->part[k][0]);
    s->part[k][0][0] = norm;
    s->part[k][0][1] = rows;
    s->part[k][0][2] = ones;
    memcpy(s->part[k][1], light, sizeof light);
    memcpy(s->part[k][2], measured, sizeof measured);
    memcpy(s->part[k][3], sum, sizeof sum);
}

/* Fill j's right-hand side; false: there is nothing to solve. */
static bool prepare(struct rec_job *j)
{
    size_t rows = rec_job_row_chunks(j);
    double sum[4], weight[4];
    j->w4 = j->p->lanes ? j->s->weight4 : NULL;
    pvx_pool_run(j->a->pool, rows, prepare_chunk, j);
    rec_job_sum(j, 0, rows, 0, sum);
    rec_job_sum(j, 0, rows, 1, j->light);
    rec_job_sum(j, 0, rows, 2, j->measured);
    rec_job_sum(j, 0, rows, 3, weight);
    j->b_norm2 = sum[0];
    j->m = sum[1] * j->s->nch;
    j->whole = sum[2] == j->a->rows;
    for (int l = 0; l < 4; l++)
        j->share[l] = 1;
    if (j->w4 != NULL) {
        j->m = rec_lanes_total(j->measured);
        for (int l = 0; l < 4 && weight[3] > 0; l++)
            j->share[l] = l < 3 ? weight[l] / weight[3] : 1;
    }
    j->s->b_norm2 = j->b_norm2;
    j->s->m = j->m;
    j->s->whole = j->whole;
    j->s->lanes = j->w4 != NULL;
    memcpy(j->s->measured, j->measured, sizeof j->measured);
    memcpy(j->s->share, j->share, sizeof j->share);
    return j->a->n > 0 && j->a->nnz > 0 && j->m > 0 && j->b_norm2 > 0;
}

/* What rec_solve_weight prepared a moment ago. */
static void take_back(struct rec_job *j)
{
    j->b_norm2 = j->s->b_norm2;
    j->m = j->s->m;
    j->whole = j->s->whole;
    j->w4 = j->s->lanes ? j->s->weight4 : NULL;
    memcpy(j->measured, j->s->measured, sizeof j->measured);
    memcpy(j->share, j->s->share, sizeof j->share);
    j->have_diag = true;
}

bool rec_solve_weight(rec_solver *s, const struct rec_subsys *a, const float *b, const float *w,
                      double sigma, const struct rec_solve_params *p, double weight[4],
                      double noise2[4])
{
    struct rec_job j = {.s = s,
                        .a = a,
                        .b = s->b,
                        .w = s->weight,
                        .image = b,
                        .image_weight = w,
                        .sigma = sigma,
                        .p = p};
    memset(weight, 0, 4 * sizeof *weight);
    memset(noise2, 0, 4 * sizeof *noise2);
    if (!prepare(&j))
        return false;
    rec_job_lambda(&j, weight, noise2);
    return true;
}

double rec_solve_fit(rec_solver *s, const struct rec_subsys *a, bool scale, float *x)
{
    struct rec_job j = {.s = s, .a = a, .b = s->b, .w = s->weight, .x = x};
    double sum[4];
    take_back(&j);
    if (scale)
        scale_start(&j);
    rec_job_start(&j, sum);
    return rec_lanes_total(sum);
}

pvx_err rec_solve(rec_solver *s, const struct rec_subsys *a, const float *b, const float *w,
                  double sigma, const struct rec_solve_params *p, float *x, rec_trace_fn trace,
                  void *trace_ctx, struct rec_solve_report *out)
{
    const struct method *m = &methods[0];
    *out = (struct rec_solve_report){.status = REC_EMPTY};
    if (p->solver != NULL && *p->solver != '\0') {
        m = NULL;
        for (size_t i = 0; i < N_METHODS; i++)
            if (strcmp(methods[i].name, p->solver) == 0)
                m = &methods[i];
        if (m == NULL)
            return PVX_EINVAL;
    }
    if (p->lanes && (m != &methods[0] || s->nch != 3))
        return PVX_EUNSUP;
    int64_t start = pvx_now_mono();
    out->solver = m->name;
    struct rec_job j = {.s = s,
                        .a = a,
                        .b = s->b,
                        .w = s->weight,
                        .image = b,
                        .image_weight = w,
                        .sigma = sigma,
                        .p = p,
                        .x = x,
                        .trace = trace,
                        .trace_ctx = trace_ctx,
                        .out = out};
    double sum[4];
    bool any = true;
    if (p->prepared)
        take_back(&j);
    else
        any = prepare(&j);
    if (!any) {
        memset(x, 0, (size_t)a->n * (size_t)a->cs * sizeof *x);
        out->time_ns = pvx_now_mono() - start;
        return PVX_OK;
    }
    j.zero = !p->good_start && rec_job_norm_x(&j, x) == 0;
    if (!j.zero && !p->good_start)
        scale_start(&j);
    out->residual_norm = out->solution_norm = -1;
    if (rec_job_late(&j))
        out->status = REC_DEADLINE; /* x as it is, and no time for more */
    else
        m->run(&j);
    if (out->residual_norm < 0) {
        rec_job_residual(&j, x, s->yv[0], s->yv[1], sum);
        out->residual_norm = sqrt(rec_lanes_total(sum));
    }
    if (out->solution_norm < 0)
        out->solution_norm = rec_job_norm_x(&j, x);
    out->rel_residual = out->residual_norm / sqrt(j.b_norm2);
    out->time_ns = pvx_now_mono() - start;
    return PVX_OK;
}
