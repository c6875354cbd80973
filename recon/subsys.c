#include "recon/subsys.h"

#include <string.h>

size_t rec_rowspace(const rec_sysmat *S, size_t *row0)
{
    size_t rows = 0;
    for (size_t c = 0; c < S->n_cameras; c++) {
        row0[c] = rows;
        rows += (size_t)S->block[c].bw * (size_t)S->block[c].bh;
    }
    row0[S->n_cameras] = rows;
    return rows;
}

struct init {
    struct rec_subsys *a;
    uint8_t *touched;
    uint64_t nnz[REC_MAX_CAMERAS];
    int64_t rows[REC_MAX_CAMERAS];
};

static void init_camera(void *ctx, size_t c)
{
    struct init *t = ctx;
    struct rec_subsys *a = t->a;
    const struct rec_sysmat_block *b = &a->S->block[c];
    uint32_t lo = UINT32_MAX, hi = 0;
    uint64_t nnz = 0;
    int64_t rows = 0;
    a->span[c].lo = a->span[c].hi = 0;
    t->nnz[c] = 0;
    t->rows[c] = 0;
    uint8_t *touched = t->touched + a->row0[c];
    memset(touched, 0, a->row0[c + 1] - a->row0[c]);
    if (!a->present[c])
        return;
    for (int32_t q = 0; q < a->n; q++) {
        uint32_t e = b->colptr[a->col[q]], end = b->colptr[a->col[q] + 1];
        if (e == end)
            continue;
        nnz += end - e;
        if (b->row[e] < lo)
            lo = b->row[e];
        if (b->row[end - 1] >= hi)
            hi = b->row[end - 1] + 1;
        for (; e < end; e++)
            touched[b->row[e]] = 1;
    }
    if (hi == 0)
        return;
    for (uint32_t i = lo; i < hi; i++)
        rows += touched[i];
    a->span[c].lo = lo;
    a->span[c].hi = hi;
    t->nnz[c] = nnz;
    t->rows[c] = rows;
}

void rec_subsys_init(struct rec_subsys *a, const rec_sysmat *S, const struct rec_kernels *k,
                     pvx_pool *pool, int cs, const int32_t *col, int32_t n, const bool *present,
                     uint8_t *touched)
{
    *a = (struct rec_subsys){.S = S, .k = k, .pool = pool, .cs = cs, .n = n, .col = col};
    a->touched = touched;
    (void)rec_rowspace(S, a->row0);
    memcpy(a->present, present, S->n_cameras * sizeof *present);
    struct init t = {.a = a, .touched = touched};
    pvx_pool_run(pool, S->n_cameras, init_camera, &t);
    for (size_t c = 0; c < S->n_cameras; c++) {
        a->nnz += t.nnz[c];
        a->rows += t.rows[c];
    }
}

struct product {
    const struct rec_subsys *a;
    const float *in;
    float *out, *out1;
};

static void forward_camera(void *ctx, size_t c)
{
    struct product *t = ctx;
    const struct rec_subsys *a = t->a;
    size_t cs = (size_t)a->cs, lo = a->span[c].lo, hi = a->span[c].hi;
    if (lo >= hi)
        return;
    float *y = t->out + a->row0[c] * cs;
    memset(y + lo * cs, 0, (hi - lo) * cs * sizeof *y);
    (a->cs == 4 ? a->k->scatter4 : a->k->scatter1)(&a->S->block[c], a->col, 0, a->n, t->in, y);
}

void rec_forward(const struct rec_subsys *a, const float *x, float *y)
{
    struct product t = {.a = a, .in = x, .out = y};
    pvx_pool_run(a->pool, a->S->n_cameras, forward_camera, &t);
}

static void chunk_range(const struct rec_subsys *a, size_t k, int32_t *q0, int32_t *q1)
{
    int32_t c = rec_chunk(a->n);
    *q0 = (int32_t)k * c;
    *q1 = *q0 + c < a->n ? *q0 + c : a->n;
}

static void adjoint_chunk(void *ctx, size_t k)
{
    struct product *t = ctx;
    const struct rec_subsys *a = t->a;
    int32_t q0, q1;
    chunk_range(a, k, &q0, &q1);
    rec_adjoint_range(a, t->in, q0, q1, t->out);
}

void rec_adjoint_range(const struct rec_subsys *a, const float *y, int32_t q0, int32_t q1, float *x)
{
    size_t cs = (size_t)a->cs;
    memset(x + (size_t)q0 * cs, 0, (size_t)(q1 - q0) * cs * sizeof *x);
    for (size_t c = 0; c < a->S->n_cameras; c++)
        if (a->span[c].lo < a->span[c].hi)
            (a->cs == 4 ? a->k->gather4 : a->k->gather1)(&a->S->block[c], a->col, q0, q1,
                                                         y + a->row0[c] * cs, x);
}

void rec_adjoint(const struct rec_subsys *a, const float *y, float *x)
{
    struct product t = {.a = a, .in = y, .out = x};
    pvx_pool_run(a->pool, rec_chunks(a->n), adjoint_chunk, &t);
}

static void norms_chunk(void *ctx, size_t k)
{
    struct product *t = ctx;
    const struct rec_subsys *a = t->a;
    int32_t q0, q1;
    chunk_range(a, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        double d2 = 0, d1 = 0;
        for (size_t c = 0; c < a->S->n_cameras; c++) {
            if (a->span[c].lo >= a->span[c].hi)
                continue;
            const struct rec_sysmat_block *b = &a->S->block[c];
            const float *w = t->in == NULL ? NULL : t->in + a->row0[c];
            for (uint32_t e = b->colptr[a->col[q]]; e < b->colptr[a->col[q] + 1]; e++) {
                double v = b->val[e], wv = w == NULL ? v : v * w[b->row[e]];
                d2 += v * wv;
                d1 += wv;
            }
        }
        if (t->out != NULL)
            t->out[q] = (float)d2;
        if (t->out1 != NULL)
            t->out1[q] = (float)d1;
    }
}

void rec_column_norms(const struct rec_subsys *a, const float *row_weight, float *d2, float *d1)
{
    struct product t = {.a = a, .in = row_weight, .out = d2, .out1 = d1};
    pvx_pool_run(a->pool, rec_chunks(a->n), norms_chunk, &t);
}

struct dot {
    const struct rec_subsys *a;
    const float *u, *v;
    double part[REC_MAX_CHUNKS][4];
};

void rec_dot_range(const float *u, const float *v, size_t n, int cs, double out[4])
{
    double s[4] = {0};
    if (cs == 1) {
        for (size_t i = 0; i < n; i++)
            s[0] += (double)u[i] * v[i];
    } else {
        for (size_t i = 0; i < n; i++)
            for (int l = 0; l < 4; l++)
                s[l] += (double)u[i * 4 + l] * v[i * 4 + l];
    }
    memcpy(out, s, sizeof s);
}

void rec_sum_parts(const double (*part)[4], size_t n, double out[4])
{
    double s[4] = {0};
    for (size_t k = 0; k < n; k++)
        for (int l = 0; l < 4; l++)
            s[l] += part[k][l];
    memcpy(out, s, sizeof s);
}

static void dot_chunk(void *ctx, size_t k)
{
    struct dot *t = ctx;
    int32_t q0, q1;
    chunk_range(t->a, k, &q0, &q1);
    size_t o = (size_t)q0 * (size_t)t->a->cs;
    rec_dot_range(t->u + o, t->v + o, (size_t)(q1 - q0), t->a->cs, t->part[k]);
}

void rec_dot_x(const struct rec_subsys *a, const float *u, const float *v, double out[4])
{
    struct dot t = {.a = a, .u = u, .v = v};
    pvx_pool_run(a->pool, rec_chunks(a->n), dot_chunk, &t);
    rec_sum_parts((const double(*)[4])t.part, rec_chunks(a->n), out);
}

static void dot_camera(void *ctx, size_t c)
{
    struct dot *t = ctx;
    const struct rec_subsys *a = t->a;
    size_t o = (a->row0[c] + a->span[c].lo) * (size_t)a->cs;
    rec_dot_range(t->u + o, t->v + o, a->span[c].hi - a->span[c].lo, a->cs, t->part[c]);
}

void rec_dot_y(const struct rec_subsys *a, const float *u, const float *v, double out[4])
{
    struct dot t = {.a = a, .u = u, .v = v};
    pvx_pool_run(a->pool, a->S->n_cameras, dot_camera, &t);
    rec_sum_parts((const double(*)[4])t.part, a->S->n_cameras, out);
}
