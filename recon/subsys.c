#include "recon/subsys.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/simd/lanes.h"

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
 * that they count in.  Counts are zero again when they have been used. */
#define BLOCK  32
#define GROUP  8  /* blocks whose marks are read at once */
#define RANGES 16 /* of groups: tasks of the numbering */
#define AHEAD  16 /* columns between a prefetch and its use */

static size_t groups_of(size_t rows)
{
    return (rows + BLOCK * GROUP - 1) / (BLOCK * GROUP);
}

static bool reserve_strips(struct rec_subsys *a, size_t rows)
{
    bool ok = true;
    size_t groups = groups_of(rows);
    a->strips =
        pvx_pool_threads(a->pool) < REC_STRIPS_MAX ? pvx_pool_threads(a->pool) : REC_STRIPS_MAX;
    for (size_t s = 0; s < a->strips; s++) {
        struct rec_strip *t = &a->strip[s];
        t->count = pvx_reserve(groups * GROUP * BLOCK * sizeof *t->count);
        t->place = pvx_reserve(groups * GROUP * BLOCK * sizeof *t->place);
        t->touched = pvx_reserve(groups * GROUP);
        ok = ok && t->count != NULL && t->place != NULL && t->touched != NULL;
    }
    return ok;
}
static void release_strips(struct rec_subsys *a, size_t rows)
{
    size_t groups = groups_of(rows);
    for (size_t s = 0; s < a->strips; s++) {
        struct rec_strip *t = &a->strip[s];
        pvx_unreserve(t->count, groups * GROUP * BLOCK * sizeof *t->count);
        pvx_unreserve(t->place, groups * GROUP * BLOCK * sizeof *t->place);
        pvx_unreserve(t->touched, groups * GROUP);
    }
}

static bool reserve_gather(struct rec_packed *g, size_t outputs, size_t nnz)
{
    g->ptr = pvx_reserve((outputs + 1) * sizeof *g->ptr);
    g->entry = pvx_reserve(nnz * sizeof *g->entry);
    return g->ptr != NULL && g->entry != NULL;
}
static void release_gather(struct rec_packed *g, size_t outputs, size_t nnz)
{
    pvx_unreserve(g->ptr, (outputs + 1) * sizeof *g->ptr);
    pvx_unreserve(g->entry, nnz * sizeof *g->entry);
}

/* Voxels and rows that an index of 26 bits can name; 6 are left for the value. */
#define MOST ((size_t)1 << 26)

pvx_err rec_subsys_new(const rec_sysmat *S, const struct rec_kernels *k, pvx_pool *pool, int cs,
                       struct rec_subsys **out)
{
    *out = NULL;
    if (column_room(S) > UINT32_MAX || rec_grid_count(&S->grid) > MOST ||
        S->row0[S->n_cameras] > MOST)
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
    a->norm2 = pvx_reserve(rec_grid_count(&S->grid) * sizeof *a->norm2);
    bool ok = a->ray != NULL && a->norm2 != NULL && reserve_strips(a, rows);
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
    pvx_unreserve(a->norm2, rec_grid_count(&a->S->grid) * sizeof *a->norm2);
    release_strips(a, rows);
    free(a);
    *ap = NULL;
}

struct restriction {
    struct rec_subsys *a;
    size_t groups;
    uint32_t range_rows[RANGES], range_nnz[RANGES]; /* then the first of each */
    bool all;                                       /* cameras are present */
    /* Rows of the present cameras, [lo,hi) ascending, then a sentinel. */
    uint32_t lo[REC_MAX_CAMERAS + 1], hi[REC_MAX_CAMERAS + 1];
};

static void strip_range(const struct rec_subsys *a, size_t strip, int32_t *q0, int32_t *q1)
{
    *q0 = (int32_t)((int64_t)a->n * (int64_t)strip / (int64_t)a->strips);
    *q1 = (int32_t)((int64_t)a->n * (int64_t)(strip + 1) / (int64_t)a->strips);
}

/* Whether row r is of a present camera; k goes along with the rows of a column. */
static inline bool is_present(const struct restriction *t, size_t *k, uint32_t r)
{
    while (r >= t->hi[*k])
        ++*k;
    return r >= t->lo[*k];
}

static inline void count(struct rec_strip *s, uint32_t row)
{
    s->count[row]++;
    s->touched[row / BLOCK] = 1;
}

/* Columns that follow one another in S are one run of entries. */
static void count_all(const struct rec_subsys *a, struct rec_strip *s, int32_t q0, int32_t q1)
{
    const uint32_t *colptr = a->S->colptr, *row = a->S->row;
    for (int32_t q = q0, next; q < q1; q = next) {
        uint32_t room = 0, j = (uint32_t)a->col[q], first = colptr[j], last = first;
        for (next = q; next < q1 && (uint32_t)a->col[next] == j; next++) {
            uint32_t end = colptr[++j];
            room += padded(end - last);
            last = end;
        }
        if (next < q1)
            __builtin_prefetch(&row[colptr[a->col[next]]]);
        for (uint32_t e = first; e < last; e++)
            count(s, row[e]);
        s->room += room;
    }
}

static void count_present(const struct restriction *t, struct rec_strip *s, int32_t q0, int32_t q1)
{
    const struct rec_subsys *a = t->a;
    const uint32_t *colptr = a->S->colptr, *row = a->S->row;
    for (int32_t q = q0; q < q1; q++) {
        uint32_t n = 0, end = colptr[a->col[q] + 1];
        size_t k = 0;
        for (uint32_t e = colptr[a->col[q]]; e < end; e++)
            if (is_present(t, &k, row[e])) {
                count(s, row[e]);
                n++;
            }
        s->room += padded(n);
    }
}

static void count_strip(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    struct rec_strip *s = &t->a->strip[i];
    int32_t q0, q1;
    strip_range(t->a, i, &q0, &q1);
    s->room = 0;
    if (t->all)
        count_all(t->a, s, q0, q1);
    else
        count_present(t, s, q0, q1);
}

/* The marks of a group's blocks over all strips, a byte each. */
static uint64_t marks(const struct rec_subsys *a, size_t group)
{
    uint64_t any = 0, m;
    for (size_t s = 0; s < a->strips; s++) {
        memcpy(&m, a->strip[s].touched + group * GROUP, sizeof m);
        any |= m;
    }
    return any;
}

/* Entries of the rows of a block, over all strips. */
static void block_counts(const struct rec_subsys *a, size_t block, uint32_t sum[BLOCK])
{
    memcpy(sum, a->strip[0].count + block * BLOCK, BLOCK * sizeof *sum);
    for (size_t s = 1; s < a->strips; s++)
        for (size_t r = 0; r < BLOCK; r++)
            sum[r] += a->strip[s].count[block * BLOCK + r];
}

static void sum_range(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    uint32_t rows = 0, nnz = 0, sum[BLOCK];
    for (size_t g = t->groups * i / RANGES; g < t->groups * (i + 1) / RANGES; g++) {
        uint64_t m = marks(t->a, g);
        for (size_t b = g * GROUP; m != 0; b++, m >>= 8) {
            if ((m & 1) == 0)
                continue;
            block_counts(t->a, b, sum);
            for (size_t r = 0; r < BLOCK; r++) {
                rows += sum[r] > 0;
                nnz += sum[r];
            }
        }
    }
    t->range_rows[i] = rows;
    t->range_nnz[i] = nnz;
}

/* Counts -> places: rows get their numbers in A, by_row.ptr and ray.  Returns the next row. */
static uint32_t number_block(struct rec_subsys *a, size_t block, uint32_t row, uint32_t *nnz)
{
    uint32_t sum[BLOCK], at = *nnz;
    block_counts(a, block, sum);
    for (size_t r = 0; r < BLOCK; r++) {
        if (sum[r] == 0)
            continue;
        size_t of_s = block * BLOCK + r;
        a->ray[row] = (uint32_t)of_s;
        a->by_row.ptr[row] = at;
        for (size_t s = 0; s < a->strips; s++) {
            a->strip[s].place[of_s] = (struct rec_place){at, row};
            at += a->strip[s].count[of_s];
        }
        row++;
    }
    for (size_t s = 0; s < a->strips; s++)
        memset(a->strip[s].count + block * BLOCK, 0, BLOCK * sizeof *a->strip[s].count);
    *nnz = at;
    return row;
}

static void number_range(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    uint32_t row = t->range_rows[i], nnz = t->range_nnz[i];
    for (size_t g = t->groups * i / RANGES; g < t->groups * (i + 1) / RANGES; g++) {
        uint64_t m = marks(t->a, g);
        if (m == 0)
            continue;
        for (size_t b = g * GROUP; m != 0; b++, m >>= 8)
            if (m & 1)
                row = number_block(t->a, b, row, &nnz);
        for (size_t s = 0; s < t->a->strips; s++)
            memset(t->a->strip[s].touched + g * GROUP, 0, GROUP);
    }
}

/* One entry of column q to both copies.  A row is come back to after many others: what it needs then,
 * its next cache line, is asked for now. */
static inline void fill(uint32_t *by_row, uint32_t *by_col, struct rec_place *p, uint32_t q,
                        uint32_t val)
{
    uint32_t *r = by_row + p->at++;
    __builtin_prefetch(r + 16, 1);
    *r = q | val;
    *by_col = p->number | val;
}

/* Value of an entry of S in its place above the index; where that leaves less than 16 bits, rounded. */
static inline uint32_t packed_value(uint32_t v, uint32_t bits)
{
    uint32_t drop = bits - 16, half = (1u << drop) >> 1;
    return (v + half) >> drop << bits;
}

/* Norm of column q from the sums of its values and their squares, which are exact in integers; so are
 * the strip's, whatever the strips are. */
static inline void add_norm(const struct rec_subsys *a, struct rec_strip *s, int32_t q,
                            uint64_t sum, uint64_t sum2)
{
    a->norm2[q] = (float)((double)a->S->unit * a->S->unit * (double)sum2);
    s->sum += sum;
    s->sum2 += sum2;
}

static void fill_all(const struct rec_subsys *a, struct rec_strip *s, int32_t q0, int32_t q1)
{
    const uint32_t *colptr = a->S->colptr, *row = a->S->row;
    const uint16_t *val = a->S->val;
    const uint32_t bits = a->by_row.bits;
    uint32_t *by_row = a->by_row.entry, *by_col = a->by_col.entry;
    struct rec_place *place = s->place;
    uint32_t at = s->room;
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = colptr[a->col[q]], end = colptr[a->col[q] + 1];
        uint32_t full = at + padded(end - e),
                 ahead = colptr[a->col[q + AHEAD < q1 ? q + AHEAD : q]];
        __builtin_prefetch(&row[ahead]);
        __builtin_prefetch(&val[ahead]);
        uint64_t sum = 0, sum2 = 0;
        a->by_col.ptr[q] = at;
        a->norm2[q] = 0;
        if (e == end)
            continue;
        /* the padding first: how much it is can not be foreseen, that it is 4 can */
        uint32_t zero = place[row[end - 1]].number;
        for (uint32_t i = 1; i <= 4; i++)
            by_col[full - i] = zero;
        for (; e < end; e++) {
            uint64_t v = val[e];
            sum += v;
            sum2 += v * v;
            fill(by_row, by_col + at++, &place[row[e]], (uint32_t)q, packed_value(val[e], bits));
        }
        add_norm(a, s, q, sum, sum2);
        at = full;
    }
}

static void fill_present(const struct restriction *t, struct rec_strip *s, int32_t q0, int32_t q1)
{
    const struct rec_subsys *a = t->a;
    const uint32_t *colptr = a->S->colptr, *row = a->S->row;
    uint32_t *by_col = a->by_col.entry;
    uint32_t at = s->room;
    for (int32_t q = q0; q < q1; q++) {
        uint32_t first = at, end = colptr[a->col[q] + 1];
        uint64_t sum = 0, sum2 = 0;
        size_t k = 0;
        a->by_col.ptr[q] = first;
        for (uint32_t e = colptr[a->col[q]]; e < end; e++)
            if (is_present(t, &k, row[e])) {
                uint64_t v = a->S->val[e];
                sum += v;
                sum2 += v * v;
                fill(a->by_row.entry, by_col + at++, &s->place[row[e]], (uint32_t)q,
                     packed_value(a->S->val[e], a->by_row.bits));
            }
        add_norm(a, s, q, sum, sum2);
        for (; at < first + padded(at - first); at++)
            by_col[at] = rec_packed_index(&a->by_col, at - 1);
    }
}

static void fill_strip(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    int32_t q0, q1;
    strip_range(t->a, i, &q0, &q1);
    t->a->strip[i].sum = t->a->strip[i].sum2 = 0;
    if (t->all)
        fill_all(t->a, &t->a->strip[i], q0, q1);
    else
        fill_present(t, &t->a->strip[i], q0, q1);
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
    size_t n = 0, cameras = a->S->n_cameras;
    for (size_t c = 0; c < cameras; c++) {
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
    t->all = n == 1 && t->lo[0] == 0 && t->hi[0] == a->row0[cameras];
    t->lo[n] = t->hi[n] = UINT32_MAX;
}

void rec_subsys_restrict(struct rec_subsys *a, const int32_t *col, int32_t n, const bool *present)
{
    struct restriction t = {.a = a, .groups = groups_of(a->row0[a->S->n_cameras])};
    a->col = col;
    a->n = n;
    memcpy(a->present, present, a->S->n_cameras * sizeof *present);
    list_present(&t);
    pvx_pool_run(a->pool, a->strips, count_strip, &t);
    pvx_pool_run(a->pool, RANGES, sum_range, &t);
    a->rows = (int32_t)first_of_each(t.range_rows, RANGES);
    a->nnz = first_of_each(t.range_nnz, RANGES);
    uint32_t room = 0;
    for (size_t s = 0; s < a->strips; s++) {
        uint32_t of_strip = a->strip[s].room;
        a->strip[s].room = room;
        room += of_strip;
    }
    pvx_pool_run(a->pool, RANGES, number_range, &t);
    uint32_t bits = 16;
    while (1ull << bits < (uint64_t)(n > a->rows ? n : a->rows))
        bits++;
    a->by_row.bits = a->by_col.bits = bits;
    a->by_row.unit = a->by_col.unit = a->S->unit * (float)(1u << (bits - 16));
    pvx_pool_run(a->pool, a->strips, fill_strip, &t);
    a->by_row.ptr[a->rows] = (uint32_t)a->nnz;
    a->by_col.ptr[n] = room;
    uint64_t sum = 0, sum2 = 0;
    for (size_t s = 0; s < a->strips; s++) {
        sum += a->strip[s].sum;
        sum2 += a->strip[s].sum2;
    }
    a->sum = (double)a->S->unit * (double)sum;
    a->sum2 = (double)a->S->unit * a->S->unit * (double)sum2;
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
    const struct rec_packed *g = &t->a->by_col;
    int32_t q0, q1;
    rec_chunk_range(t->a->n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        double d2 = 0, d1 = 0;
        for (uint32_t e = g->ptr[q]; e < g->ptr[q + 1]; e++) {
            double v = rec_packed_value(g, e);
            double wv = t->in == NULL ? v : v * t->in[rec_packed_index(g, e)];
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

REC_INLINE void dot_lanes(struct dot *t, size_t k, size_t cs)
{
    int32_t i0, i1;
    rec_d4 sum = {0};
    rec_chunk_range(t->n, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        rec_add_product(&sum, rec_ld(t->u, i, cs), rec_ld(t->v, i, cs));
    rec_put(t->part[k], &sum);
}
static void dot_chunk(void *ctx, size_t k)
{
    struct dot *t = ctx;
    t->cs == 4 ? dot_lanes(t, k, 4) : dot_lanes(t, k, 1);
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
