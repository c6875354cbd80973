#include "recon/subsys.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

size_t rec_rowspace(const rec_sysmat *S, size_t *row0)
{
    memcpy(row0, S->row0, (S->n_cameras + 1) * sizeof *row0);
    return row0[S->n_cameras];
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

/* The columns are cut into strips of as many each, one per thread at most.  Every strip counts its
 * entries per row in a work area of its own; numbering turns the counts into the places where the
 * strip's entries of a row go.  That is the order of the columns whatever the strips are, and so is
 * every other output.
 * Of the row space only what the hull is seen in is looked at: strips mark the blocks of BLOCK rows
 * that they count in, and clear just these the next time. */
#define BLOCK  32
#define RANGES 16 /* of blocks: tasks of the numbering */

static size_t blocks_of(size_t rows)
{
    return (rows + BLOCK - 1) / BLOCK;
}

static bool reserve_strips(struct rec_subsys *a, size_t rows)
{
    bool ok = true;
    a->strips =
        pvx_pool_threads(a->pool) < REC_STRIPS_MAX ? pvx_pool_threads(a->pool) : REC_STRIPS_MAX;
    for (size_t s = 0; s < a->strips; s++) {
        a->strip[s].place = pvx_reserve(blocks_of(rows) * BLOCK * sizeof *a->strip[s].place);
        a->strip[s].touched = pvx_reserve(blocks_of(rows));
        ok = ok && a->strip[s].place != NULL && a->strip[s].touched != NULL;
    }
    return ok;
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
    if (column_room(S) > UINT32_MAX)
        return PVX_ERANGE;
    struct rec_subsys *a = pvx_calloc(1, sizeof *a);
    if (a == NULL)
        return PVX_ENOMEM;
    a->S = S;
    a->k = k;
    a->pool = pool;
    a->cs = cs;
    size_t rows = rec_rowspace(S, a->row0);
    a->ray = pvx_reserve(rows * sizeof *a->ray);
    bool ok = a->ray != NULL && reserve_strips(a, rows);
    ok = reserve_gather(&a->by_row, rows, S->nnz) && ok;
    ok = reserve_gather(&a->by_col, rec_grid_count(&S->grid), column_room(S)) && ok;
    if (!ok) {
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
    for (size_t s = 0; s < a->strips; s++) {
        pvx_unreserve(a->strip[s].place, blocks_of(rows) * BLOCK * sizeof *a->strip[s].place);
        pvx_unreserve(a->strip[s].touched, blocks_of(rows));
    }
    free(a);
    *ap = NULL;
}

struct restriction {
    struct rec_subsys *a;
    size_t strips, rows, blocks;
    uint32_t range_rows[RANGES], range_nnz[RANGES]; /* then the first of each */
    /* Rows of the present cameras, [lo,hi) ascending, then a sentinel. */
    uint32_t lo[REC_MAX_CAMERAS + 1], hi[REC_MAX_CAMERAS + 1];
};

static void strip_range(const struct restriction *t, size_t strip, int32_t *q0, int32_t *q1)
{
    *q0 = (int32_t)((int64_t)t->a->n * (int64_t)strip / (int64_t)t->strips);
    *q1 = (int32_t)((int64_t)t->a->n * (int64_t)(strip + 1) / (int64_t)t->strips);
}

/* Whether row r is of a present camera; k goes along with the rows of a column. */
static inline bool present(const struct restriction *t, size_t *k, uint32_t r)
{
    while (r >= t->hi[*k])
        ++*k;
    return r >= t->lo[*k];
}

static inline void clear_strip(const struct restriction *t, struct rec_strip *s)
{
    for (size_t b = 0; b < t->blocks; b++)
        if (s->touched[b])
            memset(s->place + b * BLOCK, 0, BLOCK * sizeof *s->place);
    memset(s->touched, 0, t->blocks);
}

static inline void count_columns(const struct restriction *t, struct rec_strip *s, int32_t q0,
                                 int32_t q1, bool all)
{
    const struct rec_subsys *a = t->a;
    const uint32_t *colptr = a->S->colptr, *row = a->S->row;
    s->room = 0;
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = colptr[a->col[q]], end = colptr[a->col[q] + 1], n = all ? end - e : 0;
        size_t k = 0;
        for (; e < end; e++) {
            if (!all && !present(t, &k, row[e]))
                continue;
            s->place[row[e]].at++;
            s->touched[row[e] / BLOCK] = 1;
            n += !all;
        }
        s->room += padded(n);
    }
}

static void count_strip(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    int32_t q0, q1;
    strip_range(t, i, &q0, &q1);
    clear_strip(t, &t->a->strip[i]);
    if (t->lo[0] == 0 && t->hi[0] == t->rows)
        count_columns(t, &t->a->strip[i], q0, q1, true);
    else
        count_columns(t, &t->a->strip[i], q0, q1, false);
}

static void range_blocks(const struct restriction *t, size_t i, size_t *b0, size_t *b1)
{
    *b0 = t->blocks * i / RANGES;
    *b1 = t->blocks * (i + 1) / RANGES;
}

/* Entries of the rows of block b, over the strips; false when there are none. */
static inline bool block_counts(const struct restriction *t, size_t b, uint32_t count[BLOCK])
{
    bool any = false;
    memset(count, 0, BLOCK * sizeof *count);
    for (size_t s = 0; s < t->strips; s++) {
        const struct rec_strip *strip = &t->a->strip[s];
        if (!strip->touched[b])
            continue;
        any = true;
        for (size_t r = 0; r < BLOCK; r++)
            count[r] += strip->place[b * BLOCK + r].at;
    }
    return any;
}

static void sum_range(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    uint32_t rows = 0, nnz = 0, count[BLOCK];
    size_t b0, b1;
    range_blocks(t, i, &b0, &b1);
    for (size_t b = b0; b < b1; b++)
        if (block_counts(t, b, count))
            for (size_t r = 0; r < BLOCK; r++) {
                rows += count[r] > 0;
                nnz += count[r];
            }
    t->range_rows[i] = rows;
    t->range_nnz[i] = nnz;
}

/* Counts -> places: rows get their numbers in A, by_row.ptr and ray. */
static void number_range(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    struct rec_subsys *a = t->a;
    uint32_t row = t->range_rows[i], at = t->range_nnz[i], count[BLOCK];
    size_t b0, b1;
    range_blocks(t, i, &b0, &b1);
    for (size_t b = b0; b < b1; b++) {
        if (!block_counts(t, b, count))
            continue;
        for (size_t r = 0; r < BLOCK; r++) {
            if (count[r] == 0)
                continue;
            a->ray[row] = (uint32_t)(b * BLOCK + r);
            a->by_row.ptr[row] = at;
            for (size_t s = 0; s < t->strips; s++) {
                struct rec_place *p = &a->strip[s].place[b * BLOCK + r];
                if (!a->strip[s].touched[b])
                    continue;
                uint32_t n = p->at;
                *p = (struct rec_place){at, row};
                at += n;
            }
            row++;
        }
    }
}

static inline void fill_columns(const struct restriction *t, struct rec_strip *s, uint32_t at,
                                int32_t q0, int32_t q1, bool all)
{
    const struct rec_subsys *a = t->a;
    const uint32_t *colptr = a->S->colptr, *row = a->S->row;
    const uint16_t *val = a->S->val;
    const float unit = a->S->unit;
    struct rec_entry *by_row = a->by_row.entry, *by_col = a->by_col.entry;
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = colptr[a->col[q]], end = colptr[a->col[q] + 1];
        size_t k = 0;
        a->by_col.ptr[q] = at;
        for (; e < end; e++) {
            if (!all && !present(t, &k, row[e]))
                continue;
            struct rec_place *p = &s->place[row[e]];
            float v = unit * (float)val[e];
            by_row[p->at++] = (struct rec_entry){(uint32_t)q, v};
            by_col[at++] = (struct rec_entry){p->number, v};
        }
        uint32_t full = a->by_col.ptr[q] + padded(at - a->by_col.ptr[q]);
        for (; at < full; at++)
            by_col[at] = (struct rec_entry){by_col[at - 1].idx, 0};
    }
}

static void fill_strip(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    int32_t q0, q1;
    strip_range(t, i, &q0, &q1);
    if (t->lo[0] == 0 && t->hi[0] == t->rows)
        fill_columns(t, &t->a->strip[i], t->a->strip[i].room, q0, q1, true);
    else
        fill_columns(t, &t->a->strip[i], t->a->strip[i].room, q0, q1, false);
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

static void list_present(struct restriction *t)
{
    const struct rec_subsys *a = t->a;
    size_t n = 0;
    for (size_t c = 0; c < a->S->n_cameras; c++) {
        if (!a->present[c])
            continue;
        uint32_t lo = (uint32_t)a->row0[c], hi = (uint32_t)a->row0[c + 1];
        if (n > 0 && t->hi[n - 1] == lo) {
            t->hi[n - 1] = hi;
            continue;
        }
        t->lo[n] = lo;
        t->hi[n++] = hi;
    }
    t->lo[n] = t->hi[n] = UINT32_MAX;
}

void rec_subsys_restrict(struct rec_subsys *a, const int32_t *col, int32_t n, const bool *present_)
{
    struct restriction t = {.a = a, .rows = a->row0[a->S->n_cameras]};
    a->col = col;
    a->n = n;
    memcpy(a->present, present_, a->S->n_cameras * sizeof *a->present);
    list_present(&t);
    t.blocks = blocks_of(t.rows);
    t.strips = a->strips;
    pvx_pool_run(a->pool, t.strips, count_strip, &t);
    pvx_pool_run(a->pool, RANGES, sum_range, &t);
    a->rows = (int32_t)first_of_each(t.range_rows, RANGES);
    a->nnz = first_of_each(t.range_nnz, RANGES);
    uint32_t room = 0;
    for (size_t s = 0; s < t.strips; s++) {
        uint32_t of_strip = a->strip[s].room;
        a->strip[s].room = room;
        room += of_strip;
    }
    pvx_pool_run(a->pool, RANGES, number_range, &t);
    pvx_pool_run(a->pool, t.strips, fill_strip, &t);
    a->by_row.ptr[a->rows] = (uint32_t)a->nnz;
    a->by_col.ptr[n] = room;
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
