/* Rows of bins on all levels.  A pair of rows gives one row of the next coarser level; that row and its neighbour
 * give one of the level after it.  This works because (4) of sysmat.h and its rounding (3) need only the entries of
 * one coarse bin. */
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/matrix/build_active.h"

/* First entry of bin x in the pair's first or second row. */
static size_t first_of(const struct rec_row_pair *p, const int32_t *bw, int32_t row, int32_t x)
{
    if (x == 0)
        return row == 0 ? 0 : p->second;
    return p->end[(size_t)row * (size_t)*bw + (size_t)x - 1];
}

/* Stores the kept entries of row y of level l in its band. */
static bool put_by(struct rec_active_build *b, size_t l, size_t band, const struct rec_row_pair *p,
                   int32_t y)
{
    struct rec_active_level *v = &b->level[l];
    struct rec_band *out = &v->rows.band[band];
    const struct rec_active *a = v->m->active;
    const int32_t bw = rec_bins_across(b, l);
    for (int32_t x = 0; x < bw; x++) {
        size_t from = first_of(p, &bw, y & 1, x);
        size_t to = p->end[(size_t)(y & 1) * (size_t)bw + (size_t)x], before = out->n;
        if (!rec_band_grow(out, to - from))
            return false;
        for (size_t e = from; e < to; e++) {
            uint32_t col = p->all.col[e];
            if (a != NULL && !rec_active_has(a, col))
                continue;
            out->col[out->n] = a != NULL ? rec_active_rank(a, col) : col;
            out->val[out->n++] = p->all.val[e];
        }
        v->rows.bin_n[(size_t)y * (size_t)bw + (size_t)x] = (uint32_t)(out->n - before);
    }
    return true;
}

/* ---- the next coarser level ---- */

/* Makes an empty table for n entries; *mask: its size less one. */
static bool new_table(struct rec_active_scratch *s, size_t n, uint32_t *mask)
{
    size_t size = 64;
    while (size <= n)
        size *= 2;
    if (size > s->room) {
        free(s->table);
        free(s->list);
        free(s->sorted);
        s->table = pvx_calloc(size, sizeof *s->table);
        s->list = pvx_calloc(size, sizeof *s->list);
        s->sorted = pvx_calloc(size, sizeof *s->sorted);
        s->room = s->table != NULL && s->list != NULL && s->sorted != NULL ? size : 0;
        if (s->room == 0)
            return false;
    }
    *mask = (uint32_t)size - 1;
    memset(s->table, 0xFF, size * sizeof *s->table);
    return true;
}

/* The column of the coarser level that contains a voxel. */
static uint32_t parent(const struct rec_active_level *v, uint32_t col)
{
    uint32_t row = (uint32_t)(int32_t)((col + 0.5) * v->per_nx); /* col / nx, exactly */
    return v->coarse_row[row] + (col - row * (uint32_t)v->m->grid.n[0]) / 2;
}

static void add_entries(const struct rec_active_level *v, const struct rec_row_pair *p, size_t from,
                        size_t to, struct rec_coarse_sum *table, uint32_t mask)
{
    int shift = __builtin_clz(mask);
    for (size_t e = from; e < to; e++) {
        uint32_t col = parent(v, p->all.col[e]), h = col * 2654435769u >> shift;
        while (table[h].col != col && table[h].col != UINT32_MAX)
            h = (h + 1) & mask;
        if (table[h].col == UINT32_MAX)
            table[h] = (struct rec_coarse_sum){col, 0};
        table[h].eighths += p->all.val[e];
    }
}

/* Sorts s->list by column, eight bits at a time; the result is in s->list. */
static void active_rows_sort(struct rec_active_scratch *s, size_t n, uint32_t most)
{
    for (int shift = 0; shift < 32 && most >> shift != 0; shift += 8) {
        size_t at[256] = {0}, sum = 0;
        for (size_t i = 0; i < n; i++)
            at[s->list[i].col >> shift & 255]++;
        for (size_t k = 0; k < 256; k++) {
            size_t here = at[k];
            at[k] = sum;
            sum += here;
        }
        for (size_t i = 0; i < n; i++)
            s->sorted[at[s->list[i].col >> shift & 255]++] = s->list[i];
        struct rec_coarse_sum *swap = s->list;
        s->list = s->sorted;
        s->sorted = swap;
    }
}

/* The entries of coarse bin x from those of its up to four bins, in the order of the columns, as in coarse.c. */
static bool coarse_bin(const struct rec_active_build *b, struct rec_active_scratch *s, size_t l,
                       int32_t rows, int32_t x, uint32_t doubled)
{
    const struct rec_active_level *v = &b->level[l];
    const struct rec_row_pair *p = &s->pair[l];
    const int32_t bw = rec_bins_across(b, l), last = 2 * x + 1 < bw ? 2 * x + 1 : 2 * x;
    struct rec_band *out = &s->pair[l + 1].all;
    size_t from[2], to[2], n = 0;
    uint32_t mask, most = 0;
    int32_t carry = 0;
    for (int32_t r = 0; r < rows; r++) {
        from[r] = first_of(p, &bw, r, 2 * x);
        to[r] = p->end[(size_t)r * (size_t)bw + (size_t)last];
        n += to[r] - from[r];
    }
    if (n == 0)
        return true;
    if (!new_table(s, n, &mask) || !rec_band_grow(out, n))
        return false;
    for (int32_t r = 0; r < rows; r++)
        add_entries(v, p, from[r], to[r], s->table, mask);
    n = 0;
    for (size_t h = 0; h <= mask; h++)
        if (s->table[h].col != UINT32_MAX) {
            s->list[n++] = s->table[h];
            most = s->table[h].col > most ? s->table[h].col : most;
        }
    active_rows_sort(s, n, most);
    for (size_t i = 0; i < n; i++) {
        int32_t exact = carry + (int32_t)(s->list[i].eighths << doubled), q = (exact + 4) >> 3;
        q = q > UINT8_MAX ? UINT8_MAX : q;
        carry = exact - 8 * q;
        out->col[out->n] = s->list[i].col;
        out->val[out->n] = (uint8_t)q;
        out->n += q > 0;
    }
    return true;
}

/* Makes row y of the next level from the pair of level l, which has `rows` rows. */
static bool coarse_row(const struct rec_active_build *b, struct rec_active_scratch *s, size_t l,
                       int32_t rows, int32_t y)
{
    struct rec_row_pair *to = &s->pair[l + 1];
    const int32_t bw = rec_bins_across(b, l), wide = rec_bins_across(b, l + 1);
    for (int32_t x = 0; x < wide; x++) {
        if (!coarse_bin(b, s, l, rows, x, (uint32_t)(2 * x + 1 == bw) + (uint32_t)(rows == 1)))
            return false;
        to->end[(size_t)(y & 1) * (size_t)wide + (size_t)x] = to->all.n;
    }
    return true;
}

/* Row y of level l is complete: stores it, and makes the coarser rows that it completes. */
static bool finish_row(struct rec_active_build *b, struct rec_active_scratch *s, size_t band,
                       size_t l, int32_t y)
{
    for (;; l++, y /= 2) {
        struct rec_row_pair *p = &s->pair[l];
        bool complete = (y & 1) == 1 || y + 1 == rec_bins_down(b, l), coarsest = l + 1 == b->levels;
        if (!put_by(b, l, band, p, y))
            return false;
        if (!complete && !coarsest) {
            p->second = p->all.n;
            return true;
        }
        if (!coarsest && !coarse_row(b, s, l, (y & 1) + 1, y / 2))
            return false;
        p->all.n = p->second = 0;
        if (coarsest)
            return true;
    }
}

static void active_rows_meet(struct rec_active_build *b, const uint32_t *col, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        _Atomic uint64_t *word = &b->met[col[i] / 64];
        uint64_t bit = (uint64_t)1 << col[i] % 64;
        if ((atomic_load_explicit(word, memory_order_relaxed) & bit) == 0)
            atomic_fetch_or_explicit(word, bit, memory_order_relaxed);
    }
}

static bool trace_row(struct rec_active_build *b, struct rec_active_scratch *s, int32_t y)
{
    struct rec_row_pair *p = &s->pair[0];
    for (int32_t x = 0; x < b->t.bw; x++) {
        if (!rec_band_grow(&p->all, b->t.bin_max))
            return false;
        uint32_t *col = p->all.col + p->all.n;
        size_t n = rec_rays_bin(&b->t, &s->rays, x, y, col, p->all.val + p->all.n);
        active_rows_meet(b, col, n);
        p->all.n += n;
        p->end[(size_t)(y & 1) * (size_t)b->t.bw + (size_t)x] = p->all.n;
    }
    if (b->of > 0) {
        size_t n = p->all.n - ((y & 1) != 0 ? p->second : 0);
        uint64_t most = atomic_load(&b->row_most);
        atomic_fetch_add(&b->entries, n);
        while (n > most && !atomic_compare_exchange_weak(&b->row_most, &most, n)) {
        }
    }
    return true;
}

bool rec_active_row(struct rec_active_build *b, struct rec_active_scratch *s, size_t band,
                    int32_t y)
{
    return trace_row(b, s, y) && finish_row(b, s, band, 0, y);
}
