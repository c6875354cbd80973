/* entries.h - a matrix of windows written out as entries, column by column; what recon/simd/windows.h and
 * sysmat.h say of windows is checked on the way, and a window that is not as they say ends the program. */
#ifndef ENTRIES_H
#define ENTRIES_H
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/matrix/subsys.h"

/* Column j: [colptr[j], colptr[j+1]), rows ascending, values > 0 in units. */
struct entries {
    size_t n; /* columns */
    uint32_t *colptr, *row;
    uint8_t *val;
    uint64_t nnz;
    double unit;
};

static inline double entries_value(const struct entries *e, size_t i)
{
    return e->unit * e->val[i];
}

static inline void entries_free(struct entries *e)
{
    free(e->colptr);
    free(e->row);
    free(e->val);
    *e = (struct entries){0};
}

#define ENTRIES_MUST(condition)                                                          \
    do {                                                                                 \
        if (!(condition)) {                                                              \
            fprintf(stderr, "%s:%d: windows: not %s\n", __FILE__, __LINE__, #condition); \
            abort();                                                                     \
        }                                                                                \
    } while (0)

static inline void entries_new(struct entries *e, size_t columns, uint64_t nnz, double unit)
{
    *e = (struct entries){.n = columns, .unit = unit};
    e->colptr = pvx_calloc(columns + 1, sizeof *e->colptr);
    e->row = pvx_calloc((size_t)nnz + 1, sizeof *e->row);
    e->val = pvx_calloc((size_t)nnz + 1, sizeof *e->val);
    ENTRIES_MUST(e->colptr != NULL && e->row != NULL && e->val != NULL);
}

/* One window's, unordered; it lies in its camera's image, all of it where that is possible. */
static inline void entries_add(struct entries *e, const rec_sysmat *S, size_t camera, uint32_t at,
                               const uint8_t *w)
{
    ENTRIES_MUST(camera < S->n_cameras);
    ENTRIES_MUST(at >= S->row0[camera] && at < S->row0[camera + 1]);
    uint32_t bw = (uint32_t)S->block[camera].bw, bh = (uint32_t)S->block[camera].bh;
    uint32_t high = (uint32_t)S->win.high, wide = (uint32_t)S->win.wide;
    uint32_t x = (at - (uint32_t)S->row0[camera]) % bw, y = (at - (uint32_t)S->row0[camera]) / bw;
    ENTRIES_MUST((uint32_t)S->win.pitch[camera] == bw);
    ENTRIES_MUST(bw < wide || x + wide <= bw);
    ENTRIES_MUST(bh < high || y + high <= bh);
    for (uint32_t r = 0; r < high; r++)
        for (uint32_t k = 0; k < wide; k++, w++) {
            if (*w == 0)
                continue;
            ENTRIES_MUST(x + k < bw && y + r < bh);
            e->row[e->nnz] = at + r * bw + k;
            e->val[e->nnz++] = *w;
        }
}

/* The last column's in order, none twice. */
static inline int entries_compare(const void *a, const void *b)
{
    uint64_t p = *(const uint64_t *)a, q = *(const uint64_t *)b;
    return (p > q) - (p < q);
}
static inline void entries_sort(struct entries *e, size_t from)
{
    size_t n = (size_t)e->nnz - from;
    uint64_t *key = pvx_calloc(n + 1, sizeof *key);
    ENTRIES_MUST(key != NULL);
    for (size_t i = 0; i < n; i++)
        key[i] = (uint64_t)e->row[from + i] << 8 | e->val[from + i];
    qsort(key, n, sizeof *key, entries_compare);
    for (size_t i = 0; i < n; i++) {
        e->row[from + i] = (uint32_t)(key[i] >> 8);
        e->val[from + i] = (uint8_t)key[i];
        ENTRIES_MUST(i == 0 || e->row[from + i] > e->row[from + i - 1]);
    }
    free(key);
}

/* Further windows of some columns. */
struct entries_more {
    const struct rec_more *at, *end;
};

/* Columns [q0,q1) of w, a matrix of S or restricted from it; no windows of cameras that are not present. */
static inline void entries_of_columns(struct entries *e, const rec_sysmat *S,
                                      const struct rec_windows *w, const bool *present, size_t q0,
                                      size_t q1, struct entries_more more)
{
    size_t size = rec_window_size(w), slots = (size_t)w->slots;
    for (size_t q = q0; q < q1; q++) {
        size_t from = (size_t)e->nnz;
        for (size_t c = 0; c < slots; c++) {
            const uint8_t *weight = w->w + (q * slots + c) * size;
            uint32_t at = w->at[q * slots + c];
            if (at != w->nowhere) {
                ENTRIES_MUST(present == NULL || present[c]);
                entries_add(e, S, c, at, weight);
            }
            for (size_t i = 0; at == w->nowhere && i < size; i++)
                ENTRIES_MUST(weight[i] == 0);
        }
        for (; more.at < more.end && more.at->column == q; more.at++) {
            ENTRIES_MUST(present == NULL || present[more.at->slot]);
            for (size_t i = size; i < REC_WINDOW_MAX; i++)
                ENTRIES_MUST(more.at->w[i] == 0);
            entries_add(e, S, more.at->slot, more.at->at, more.at->w);
        }
        entries_sort(e, from);
        e->colptr[q + 1] = (uint32_t)e->nnz;
    }
    ENTRIES_MUST(more.at == more.end); /* ascending, each of one of these columns */
}

static inline void entries_frame(const rec_sysmat *S)
{
    const struct rec_windows *w = &S->win;
    size_t rows = S->row0[S->n_cameras];
    ENTRIES_MUST(w->slots % REC_SLOT_GROUP == 0 && (size_t)w->slots >= S->n_cameras &&
                 (size_t)w->slots < S->n_cameras + REC_SLOT_GROUP);
    ENTRIES_MUST(rec_window_size(w) <= REC_WINDOW_MAX);
    ENTRIES_MUST(w->nowhere >= rows && w->nowhere % REC_ROW_BLOCK == 0 &&
                 w->room % REC_ROW_BLOCK == 0);
    for (size_t c = 0; c < (size_t)w->slots; c++) /* any window that begins in a bin, or nowhere */
        ENTRIES_MUST(w->nowhere + (size_t)(w->high - 1) * (size_t)w->pitch[c] + (size_t)w->wide <=
                     w->room);
}

/* All of S. */
static inline struct entries entries_of(const rec_sysmat *S)
{
    struct entries e;
    entries_frame(S);
    entries_new(&e, rec_grid_count(&S->grid), S->nnz, (double)S->unit);
    size_t weights = e.n * (size_t)S->win.slots * rec_window_size(&S->win);
    uint64_t nnz = 0;
    for (size_t i = 0; i < weights; i++)
        nnz += S->win.w[i] != 0;
    for (size_t i = 0; i < S->win.n_more; i++)
        for (size_t k = 0; k < REC_WINDOW_MAX; k++)
            nnz += S->win.more[i].w[k] != 0;
    ENTRIES_MUST(nnz == S->nnz);
    for (size_t i = 0; i < REC_WINDOWS_PAD; i++)
        ENTRIES_MUST(S->win.w[weights + i] == 0);
    entries_of_columns(&e, S, &S->win, NULL, 0, e.n,
                       (struct entries_more){S->win.more, S->win.more + S->win.n_more});
    return e;
}

/* All of A; columns are active ones, rows those of S. */
static inline struct entries entries_of_system(const struct rec_subsys *a)
{
    struct entries e;
    size_t n = (size_t)a->n, slabs = (size_t)a->slabs;
    entries_new(&e, n, a->nnz, (double)a->S->unit);
    ENTRIES_MUST(slabs >= 1 && slabs <= REC_SLABS_MAX);
    uint64_t nnz = 0;
    for (size_t i = 0; i < n * (size_t)a->win.slots * rec_window_size(&a->win); i++)
        nnz += a->win.w[i] != 0;
    for (size_t s = 0; s < slabs; s++)
        for (uint32_t i = a->more_at[s]; i < a->more_end[s]; i++)
            for (size_t k = 0; k < REC_WINDOW_MAX; k++)
                nnz += a->win.more[i].w[k] != 0;
    ENTRIES_MUST(nnz == a->nnz);
    for (size_t s = 0; s < slabs; s++) {
        int32_t q0, q1;
        rec_slab_range(a, s, &q0, &q1);
        entries_of_columns(
            &e, a->S, &a->win, a->present, (size_t)q0, (size_t)q1,
            (struct entries_more){a->win.more + a->more_at[s], a->win.more + a->more_end[s]});
    }
    return e;
}

/* The same entries by row, of `rows` there are: then `row` are columns, ascending. */
static inline struct entries entries_by_row(const struct entries *e, size_t rows)
{
    struct entries t;
    entries_new(&t, rows, e->nnz, e->unit);
    t.nnz = e->nnz;
    for (uint64_t i = 0; i < e->nnz; i++)
        t.colptr[e->row[i] + 1]++;
    for (size_t r = 0; r < rows; r++)
        t.colptr[r + 1] += t.colptr[r];
    for (size_t j = 0; j < e->n; j++)
        for (uint32_t i = e->colptr[j]; i < e->colptr[j + 1]; i++) {
            uint32_t to = t.colptr[e->row[i]]++;
            t.row[to] = (uint32_t)j;
            t.val[to] = e->val[i];
        }
    memmove(t.colptr + 1, t.colptr, rows * sizeof *t.colptr);
    t.colptr[0] = 0;
    return t;
}

/* [a->rows] the rows of A, ascending. */
static inline uint32_t *rows_of_system(const struct rec_subsys *a)
{
    int32_t n = 0;
    uint32_t *row = pvx_calloc((size_t)a->rows + 1, sizeof *row);
    ENTRIES_MUST(row != NULL);
    for (int32_t b = 0; b < a->n_blocks; b++)
        for (size_t i = (size_t)a->block[b] * REC_ROW_BLOCK, k = 0; k < REC_ROW_BLOCK; k++, i++)
            if (a->is_row[i]) {
                ENTRIES_MUST(n < a->rows);
                row[n++] = (uint32_t)i;
            }
    ENTRIES_MUST(n == a->rows);
    return row;
}
#endif
