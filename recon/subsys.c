#include "recon/subsys.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

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

/* Columns are padded with zero entries to a multiple of 4: a column has some ten entries, and a loop
 * over the rest of a division by 4 would be mispredicted every time. */
static inline uint32_t padded(uint32_t n)
{
    return (n + 3) & ~3u;
}
/* The most that columns of S may need. */
static size_t column_room(const rec_sysmat *S)
{
    return S->nnz + 3 * rec_grid_count(&S->grid);
}

static bool reserve_gather(struct rec_gather *g, size_t outputs, size_t nnz)
{
    g->ptr = pvx_reserve((outputs + 1) * sizeof *g->ptr);
    g->entry = pvx_reserve(nnz * sizeof *g->entry);
    return g->ptr != NULL && g->entry != NULL;
}
static void release_gather(struct rec_gather *g, size_t outputs, size_t nnz)
{
    pvx_unreserve(g->ptr, (outputs + 1) * sizeof *g->ptr);
    pvx_unreserve(g->entry, nnz * sizeof *g->entry);
}

pvx_err rec_subsys_new(const rec_sysmat *S, const struct rec_kernels *k, pvx_pool *pool, int cs,
                       struct rec_subsys **out)
{
    *out = NULL;
    size_t row0[REC_MAX_CAMERAS + 1];
    if (column_room(S) > UINT32_MAX || rec_rowspace(S, row0) > INT32_MAX)
        return PVX_ERANGE;
    struct rec_subsys *a = pvx_calloc(1, sizeof *a);
    if (a == NULL)
        return PVX_ENOMEM;
    a->S = S;
    a->k = k;
    a->pool = pool;
    a->cs = cs;
    memcpy(a->row0, row0, sizeof row0);
    size_t rows = row0[S->n_cameras];
    a->ray = pvx_reserve(rows * sizeof *a->ray);
    a->number = pvx_reserve(rows * sizeof *a->number);
    bool ok = reserve_gather(&a->by_row, rows, S->nnz);
    ok = reserve_gather(&a->by_col, rec_grid_count(&S->grid), column_room(S)) && ok;
    if (!ok || a->ray == NULL || a->number == NULL) {
        rec_subsys_free(&a);
        return PVX_ENOMEM;
    }
    *out = a;
    return PVX_OK;
}

void rec_subsys_free(struct rec_subsys **ap)
{
    struct rec_subsys *a = *ap;
    if (a == NULL)
        return;
    size_t rows = a->row0[a->S->n_cameras];
    release_gather(&a->by_row, rows, a->S->nnz);
    release_gather(&a->by_col, rec_grid_count(&a->S->grid), column_room(a->S));
    pvx_unreserve(a->ray, rows * sizeof *a->ray);
    pvx_unreserve(a->number, rows * sizeof *a->number);
    free(a);
    *ap = NULL;
}

struct restriction {
    struct rec_subsys *a;
    uint32_t nnz[REC_MAX_CAMERAS], rows[REC_MAX_CAMERAS]; /* of each camera, then first of each */
    uint32_t chunk_nnz[REC_MAX_CHUNKS];                   /* of each chunk of columns, then first */
};

/* Tasks are the cameras, then the chunks of columns.
 * Cameras: number[] = entries per row.  Chunks: room for their columns' entries. */
static void count_task(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    struct rec_subsys *a = t->a;
    size_t cameras = a->S->n_cameras;
    if (i < cameras) {
        const struct rec_sysmat_block *b = &a->S->block[i];
        uint32_t *count = a->number + a->row0[i], nnz = 0, rows = 0;
        size_t n = a->row0[i + 1] - a->row0[i];
        memset(count, 0, n * sizeof *count);
        for (int32_t q = 0; a->present[i] && q < a->n; q++) {
            uint32_t end = b->colptr[a->col[q] + 1];
            for (uint32_t e = b->colptr[a->col[q]]; e < end; e++)
                count[b->row[e]]++;
        }
        for (size_t r = 0; r < n; r++) {
            nnz += count[r];
            rows += count[r] > 0;
        }
        t->nnz[i] = nnz;
        t->rows[i] = rows;
        return;
    }
    int32_t q0, q1;
    uint32_t sum = 0;
    rec_chunk_range(a->n, i - cameras, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        uint32_t n = 0;
        for (size_t c = 0; c < cameras; c++)
            if (a->present[c])
                n += a->S->block[c].colptr[a->col[q] + 1] - a->S->block[c].colptr[a->col[q]];
        sum += padded(n);
    }
    t->chunk_nnz[i - cameras] = sum;
}

/* Counts -> numbers: rows of camera c get their number in A, by_row.ptr and ray. */
static void number_camera(void *ctx, size_t c)
{
    struct restriction *t = ctx;
    struct rec_subsys *a = t->a;
    uint32_t row = t->rows[c], at = t->nnz[c];
    for (size_t r = a->row0[c]; r < a->row0[c + 1]; r++) {
        uint32_t count = a->number[r];
        if (count == 0)
            continue;
        a->number[r] = row;
        a->ray[row] = (uint32_t)r;
        a->by_row.ptr[row++] = at;
        at += count;
    }
}

/* Cameras: entries by row, columns ascending; by_row.ptr[row] runs on to the row's end, which is the
 * next row's start, and is put back by shift_rows.  Chunks: entries by column. */
static void fill_task(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    struct rec_subsys *a = t->a;
    size_t cameras = a->S->n_cameras;
    if (i < cameras) {
        const struct rec_sysmat_block *b = &a->S->block[i];
        const uint32_t *number = a->number + a->row0[i];
        struct rec_gather *g = &a->by_row;
        for (int32_t q = 0; a->present[i] && q < a->n; q++) {
            uint32_t end = b->colptr[a->col[q] + 1];
            for (uint32_t e = b->colptr[a->col[q]]; e < end; e++) {
                uint32_t at = g->ptr[number[b->row[e]]]++;
                g->entry[at] = (struct rec_entry){(uint32_t)q, b->val[e]};
            }
        }
        return;
    }
    int32_t q0, q1;
    rec_chunk_range(a->n, i - cameras, &q0, &q1);
    struct rec_gather *g = &a->by_col;
    uint32_t at = t->chunk_nnz[i - cameras];
    for (int32_t q = q0; q < q1; q++) {
        g->ptr[q] = at;
        for (size_t c = 0; c < cameras; c++) {
            if (!a->present[c])
                continue;
            const struct rec_sysmat_block *b = &a->S->block[c];
            const uint32_t *number = a->number + a->row0[c];
            uint32_t end = b->colptr[a->col[q] + 1];
            for (uint32_t e = b->colptr[a->col[q]]; e < end; e++)
                g->entry[at++] = (struct rec_entry){number[b->row[e]], b->val[e]};
        }
        uint32_t end = g->ptr[q] + padded(at - g->ptr[q]);
        while (at < end) {
            g->entry[at] = (struct rec_entry){g->entry[at - 1].idx, 0};
            at++;
        }
    }
}

static uint32_t first_of_each(uint32_t *count, size_t n)
{
    uint32_t sum = 0;
    for (size_t i = 0; i < n; i++) {
        uint32_t c = count[i];
        count[i] = sum;
        sum += c;
    }
    return sum;
}

void rec_subsys_restrict(struct rec_subsys *a, const int32_t *col, int32_t n, const bool *present)
{
    size_t cameras = a->S->n_cameras, chunks = rec_chunks(n);
    a->col = col;
    a->n = n;
    memcpy(a->present, present, cameras * sizeof *present);
    struct restriction t = {.a = a};
    pvx_pool_run(a->pool, cameras + chunks, count_task, &t);
    a->nnz = first_of_each(t.nnz, cameras);
    a->rows = (int32_t)first_of_each(t.rows, cameras);
    uint32_t end = first_of_each(t.chunk_nnz, chunks);
    pvx_pool_run(a->pool, cameras, number_camera, &t);
    pvx_pool_run(a->pool, cameras + chunks, fill_task, &t);
    memmove(a->by_row.ptr + 1, a->by_row.ptr, (size_t)a->rows * sizeof *a->by_row.ptr);
    a->by_row.ptr[0] = 0;
    a->by_col.ptr[n] = end;
}

struct product {
    const struct rec_subsys *a;
    const float *in;
    float *out, *out1;
};

static void forward_chunk(void *ctx, size_t k)
{
    struct product *t = ctx;
    int32_t i0, i1;
    rec_chunk_range(t->a->rows, k, &i0, &i1);
    rec_forward_range(t->a, t->in, i0, i1, t->out);
}

void rec_forward(const struct rec_subsys *a, const float *x, float *y)
{
    struct product t = {.a = a, .in = x, .out = y};
    pvx_pool_run(a->pool, rec_chunks(a->rows), forward_chunk, &t);
}

static void adjoint_chunk(void *ctx, size_t k)
{
    struct product *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->a->n, k, &q0, &q1);
    rec_adjoint_range(t->a, t->in, q0, q1, t->out);
}

void rec_adjoint(const struct rec_subsys *a, const float *y, float *x)
{
    struct product t = {.a = a, .in = y, .out = x};
    pvx_pool_run(a->pool, rec_chunks(a->n), adjoint_chunk, &t);
}

static void norms_chunk(void *ctx, size_t k)
{
    struct product *t = ctx;
    const struct rec_gather *g = &t->a->by_col;
    int32_t q0, q1;
    rec_chunk_range(t->a->n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        double d2 = 0, d1 = 0;
        for (uint32_t e = g->ptr[q]; e < g->ptr[q + 1]; e++) {
            double v = g->entry[e].val, wv = t->in == NULL ? v : v * t->in[g->entry[e].idx];
            d2 += v * wv;
            d1 += wv;
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
    int32_t n;
    int cs;
    const float *u, *v;
    double part[REC_MAX_CHUNKS][4];
};

static void dot_chunk(void *ctx, size_t k)
{
    struct dot *t = ctx;
    int32_t i0, i1;
    rec_chunk_range(t->n, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (int l = 0; l < t->cs; l++)
            t->part[k][l] += (double)t->u[i * (size_t)t->cs + l] * t->v[i * (size_t)t->cs + l];
}

void rec_dot(const struct rec_subsys *a, int32_t n, const float *u, const float *v, double out[4])
{
    struct dot t = {.n = n, .cs = a->cs, .u = u, .v = v};
    pvx_pool_run(a->pool, rec_chunks(n), dot_chunk, &t);
    for (int l = 0; l < 4; l++) {
        out[l] = 0;
        for (size_t k = 0; k < rec_chunks(n); k++)
            out[l] += t.part[k][l];
    }
}
