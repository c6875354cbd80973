/* Entries -> windows (recon/simd/windows.h).  A camera's bins of a column are covered from the top.  A window begins
 * at the first row that has an uncovered bin, and at the leftmost uncovered bin of the rows that it spans.  The first
 * window is the column's own; the others go to `more`.
 *   choose   the shape that takes the least memory, by every SAMPLE-th column of a large S; a window in `more` counts twice, because
 *            it is also slower
 *   count    chunks of columns: windows beyond the first
 *   fill     the chunks again
 *   settle   windows with rows of four begin at an even bin if their weights allow it, so that two bins of four
 *            channels, 32 bytes, never lie in two cache lines.  Those of columns 2i and 2i+1 of a row of voxels
 *            begin at the same bin if one window is large enough for both: then a product reads and writes
 *            there once for the two */
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/matrix/entries.h"

#define CHUNK  4096 /* columns per task */
#define BINS   1024 /* bins covered at a time; a column that has more is covered in pieces */
#define SAMPLE 13   /* odd: columns of all places of a row of voxels */
#define LARGE  8192 /* columns */

static const struct shape {
    uint32_t high, wide;
} shapes[] = {{2, 2}, {2, 4}, {3, 4}, {4, 4}};
#define SHAPES (sizeof shapes / sizeof *shapes)

struct job {
    rec_sysmat *m;
    const struct rec_entries *e;
    size_t N; /* columns */
    uint64_t (*more)
        [SHAPES]; /* [chunks] windows in `more`; of the shape chosen, then the first of each chunk */
    size_t shape;
    size_t sample; /* a shape is chosen by every so many-th column */
};

/* Bins of one camera in one column, ascending. */
struct bins {
    uint32_t n, left, first; /* first: none before it is uncovered */
    uint16_t x[BINS], y[BINS];
    uint8_t val[BINS], in[BINS]; /* in: already in a window */
};

/* Loads bins of camera c from entry `from` on, up to `end` or as many as fit; returns the first entry after them. */
static uint32_t load_bins(const struct job *j, size_t c, uint32_t from, uint32_t end,
                          struct bins *b)
{
    uint32_t first = (uint32_t)j->m->row0[c], last = (uint32_t)j->m->row0[c + 1];
    uint32_t bw = (uint32_t)j->m->block[c].bw;
    double per_bw = 1.0 / bw;
    for (b->n = 0; from < end && b->n < BINS && j->e->row[from] < last; from++, b->n++) {
        uint32_t r = j->e->row[from] - first, y = (uint32_t)(int32_t)((r + 0.5) * per_bw);
        b->y[b->n] = (uint16_t)y;
        b->x[b->n] = (uint16_t)(r - y * bw);
        b->val[b->n] = j->e->val[from];
    }
    return from;
}

static void bins_uncover(struct bins *b)
{
    memset(b->in, 0, b->n);
    b->left = b->n;
    b->first = 0;
}

/* Takes the next window of the uncovered bins: returns its top left bin, and writes its weights. */
static uint32_t next_window(const struct job *j, const struct shape *s, size_t c, struct bins *b,
                            uint8_t w[REC_WINDOW_MAX])
{
    uint32_t bw = (uint32_t)j->m->block[c].bw, bh = (uint32_t)j->m->block[c].bh, i = b->first;
    while (b->in[i])
        i++;
    b->first = i;
    uint32_t y = b->y[i], x = b->x[i];
    for (uint32_t k = i + 1; k < b->n && b->y[k] < y + s->high; k++)
        if (!b->in[k] && b->x[k] < x)
            x = b->x[k];
    if (bw >= s->wide && x > bw - s->wide) /* inside the image, if possible */
        x = bw - s->wide;
    if (bh >= s->high && y > bh - s->high)
        y = bh - s->high;
    memset(w, 0, REC_WINDOW_MAX);
    for (uint32_t k = i; k < b->n && b->y[k] < y + s->high; k++) {
        uint32_t dx = (uint32_t)b->x[k] - x;
        if (b->in[k] || dx >= s->wide)
            continue;
        w[(b->y[k] - y) * s->wide + dx] = b->val[k];
        b->in[k] = 1;
        b->left--;
    }
    return (uint32_t)j->m->row0[c] + y * bw + x;
}

static uint32_t count_windows(const struct job *j, const struct shape *s, size_t c, struct bins *b)
{
    uint8_t w[REC_WINDOW_MAX];
    uint32_t n = 0;
    bins_uncover(b);
    for (; b->left > 0; n++)
        next_window(j, s, c, b, w);
    return n;
}

static size_t windows_chunk_end(const struct job *j, size_t task)
{
    return (task + 1) * CHUNK < j->N ? (task + 1) * CHUNK : j->N;
}

/* Windows beyond the first, of every step-th column of a chunk, for the shapes [s0, s1). */
static void windows_count(struct job *j, size_t task, size_t step, size_t s0, size_t s1)
{
    struct bins b = {.n = 0};
    for (size_t s = s0; s < s1; s++)
        j->more[task][s] = 0;
    for (size_t q = task * CHUNK; q < windows_chunk_end(j, task); q += step) {
        uint32_t e = j->e->colptr[q], end = j->e->colptr[q + 1];
        for (size_t c = 0; c < j->m->n_cameras; c++)
            for (uint32_t own = 1; (e = load_bins(j, c, e, end, &b)), b.n > 0; own = 0)
                for (size_t s = s0; s < s1; s++)
                    j->more[task][s] += count_windows(j, &shapes[s], c, &b) - own;
    }
}

static void sample_chunk(void *ctx, size_t task)
{
    struct job *j = ctx;
    windows_count(j, task, j->sample, 0, SHAPES);
}

static void count_chunk(void *ctx, size_t task)
{
    struct job *j = ctx;
    windows_count(j, task, 1, j->shape, j->shape + 1);
}

static void fill_chunk(void *ctx, size_t task)
{
    struct job *j = ctx;
    struct rec_windows *out = &j->m->win;
    const struct shape *s = &shapes[j->shape];
    struct bins b = {.n = 0};
    uint8_t w[REC_WINDOW_MAX];
    size_t size = rec_window_size(out), more = (size_t)j->more[task][j->shape];
    for (size_t i = task * CHUNK; i < windows_chunk_end(j, task); i++) {
        uint32_t e = j->e->colptr[i], end = j->e->colptr[i + 1];
        size_t q = rec_sysmat_voxel(j->m, i), at = q * (size_t)out->slots;
        memset(out->w + at * size, 0, (size_t)out->slots * size);
        for (size_t c = 0; c < (size_t)out->slots; c++)
            out->at[at + c] = out->nowhere;
        for (size_t c = 0; c < j->m->n_cameras; c++)
            for (bool own = true; (e = load_bins(j, c, e, end, &b)), b.n > 0;) {
                bins_uncover(&b);
                for (; b.left > 0; own = false) {
                    uint32_t first = next_window(j, s, c, &b, w);
                    struct rec_more *m = &out->more[more];
                    if (own) {
                        out->at[at + c] = first;
                        memcpy(out->w + (at + c) * size, w, size);
                        continue;
                    }
                    *m = (struct rec_more){(uint32_t)q, first, (uint32_t)c, {0}};
                    memcpy(m->w, w, size);
                    more++;
                }
            }
    }
}

/* The bins of an image that have weights. */
struct extent {
    uint32_t x0, x1, y0, y1;
};
static void extend(const struct shape *s, const uint8_t *w, uint32_t x, uint32_t y,
                   struct extent *e)
{
    for (uint32_t r = 0; r < s->high; r++)
        for (uint32_t k = 0; k < s->wide; k++, w++) {
            if (*w == 0)
                continue;
            e->x0 = x + k < e->x0 ? x + k : e->x0;
            e->x1 = x + k > e->x1 ? x + k : e->x1;
            e->y0 = y + r < e->y0 ? y + r : e->y0;
            e->y1 = y + r > e->y1 ? y + r : e->y1;
        }
}

/* Moves the windows of columns q ... q+n-1 in camera c to one place.  False: one is nowhere, or they do not fit. */
static bool windows_settle(const struct job *j, size_t c, size_t q, size_t n)
{
    struct rec_windows *out = &j->m->win;
    const struct shape *s = &shapes[j->shape];
    uint32_t bw = (uint32_t)j->m->block[c].bw, bh = (uint32_t)j->m->block[c].bh;
    uint32_t row0 = (uint32_t)j->m->row0[c], slots = (uint32_t)out->slots;
    size_t first = q * slots + c, size = rec_window_size(out);
    struct extent e = {UINT32_MAX, 0, UINT32_MAX, 0};
    for (size_t i = first; i < first + n * slots; i += slots) {
        uint32_t bin = out->at[i] - row0;
        if (out->at[i] == out->nowhere)
            return false;
        extend(s, out->w + i * size, bin % bw, bin / bw, &e);
    }
    if (e.x0 > e.x1 || e.x1 - e.x0 >= s->wide || e.y1 - e.y0 >= s->high)
        return false;
    uint32_t x = bw >= s->wide && e.x0 > bw - s->wide ? bw - s->wide : e.x0;
    uint32_t y = bh >= s->high && e.y0 > bh - s->high ? bh - s->high : e.y0;
    x -= x > 0 && (row0 + y * bw + x) % 2 == 1 && e.x1 - x + 1 < s->wide;
    for (size_t i = first; i < first + n * slots; i += slots) {
        uint8_t *w = out->w + i * size, before[REC_WINDOW_MAX];
        uint32_t bin = out->at[i] - row0, k = 0;
        memcpy(before, w, size);
        memset(w, 0, size);
        for (uint32_t r = bin / bw; k < size; r++)
            for (uint32_t b = bin % bw; b < bin % bw + s->wide; b++, k++)
                if (before[k] != 0)
                    w[(r - y) * s->wide + b - x] = before[k];
        out->at[i] = row0 + y * bw + x;
    }
    return true;
}

/* Whether a voxel is 2i of a pair 2i, 2i+1 in a row.  Bricks are even, so both are kept or none.  A pair never
 * crosses a chunk of the whole S. */
static bool is_pair(size_t voxel, size_t nx)
{
    return voxel % nx % 2 == 0 && voxel % nx + 1 < nx && voxel / CHUNK == (voxel + 1) / CHUNK;
}
/* First column of a chunk of whole pairs. */
static size_t settle_from(const struct job *j, size_t task, size_t nx)
{
    size_t i = task * CHUNK < j->N ? task * CHUNK : j->N;
    return i > 0 && i < j->N && is_pair(rec_sysmat_voxel(j->m, i - 1), nx) ? i + 1 : i;
}

static void settle_chunk(void *ctx, size_t task)
{
    const struct job *j = ctx;
    size_t nx = (size_t)j->m->grid.n[0], end = settle_from(j, task + 1, nx);
    for (size_t i = settle_from(j, task, nx), n; i < end; i += n) {
        size_t q = rec_sysmat_voxel(j->m, i);
        n = is_pair(q, nx) ? 2 : 1;
        for (size_t c = 0; c < j->m->n_cameras; c++)
            for (size_t k = n == 2 && windows_settle(j, c, q, 2) ? n : 0; k < n; k++)
                windows_settle(j, c, q + k, 1);
    }
}

/* Chooses the shape of the least memory. */
static void windows_choose(struct job *j, size_t chunks)
{
    double least = 0;
    for (size_t s = 0; s < SHAPES; s++) {
        double more = 0, size = shapes[s].high * shapes[s].wide;
        for (size_t k = 0; k < chunks; k++)
            more += (double)(j->sample * j->more[k][s]);
        double bytes = (double)j->N * j->m->win.slots * (sizeof *j->m->win.at + size) +
                       2 * more * sizeof(struct rec_more);
        if (s == 0 || bytes < least) {
            least = bytes;
            j->shape = s;
        }
    }
    j->m->win.high = (int32_t)shapes[j->shape].high;
    j->m->win.wide = (int32_t)shapes[j->shape].wide;
}

/* Sums up j->more.  false: too many windows. */
static bool windows_sum(struct job *j, size_t chunks)
{
    uint64_t sum = 0;
    for (size_t k = 0; k < chunks; k++) {
        uint64_t n = j->more[k][j->shape];
        j->more[k][j->shape] = sum;
        sum += n;
    }
    j->m->win.n_more = (uint32_t)sum;
    return sum <= UINT32_MAX;
}

void rec_sysmat_window_frame(rec_sysmat *m)
{
    struct rec_windows *w = &m->win;
    int32_t widest = 0;
    w->slots = ((int32_t)m->n_cameras + REC_SLOT_GROUP - 1) / REC_SLOT_GROUP * REC_SLOT_GROUP;
    for (size_t c = 0; c < m->n_cameras; c++) {
        w->pitch[c] = m->block[c].bw;
        widest = m->block[c].bw > widest ? m->block[c].bw : widest;
    }
    w->unit = m->unit;
    w->nowhere =
        (uint32_t)((m->row0[m->n_cameras] + REC_ROW_BLOCK - 1) & ~(size_t)(REC_ROW_BLOCK - 1));
    w->room = w->nowhere + 3 * (uint32_t)widest + 4;
    w->room = (w->room + REC_ROW_BLOCK - 1) & ~(uint32_t)(REC_ROW_BLOCK - 1);
}

pvx_err rec_sysmat_windows(rec_sysmat *m, const struct rec_entries *e, pvx_pool *pool)
{
    struct job j = {.m = m, .e = e, .N = rec_sysmat_columns(m)};
    struct rec_windows *w = &m->win;
    size_t chunks = (j.N + CHUNK - 1) / CHUNK;
    j.sample = j.N < LARGE ? 1 : SAMPLE;
    rec_sysmat_window_frame(m);
    j.more = pvx_calloc(chunks, sizeof *j.more);
    PVX_NEED(j.more);
    pvx_pool_run(pool, chunks, sample_chunk, &j);
    windows_choose(&j, chunks);
    pvx_pool_run(pool, chunks, count_chunk, &j);
    pvx_err err = windows_sum(&j, chunks) ? PVX_OK : PVX_ERANGE;
    if (err == PVX_OK) {
        struct rec_sparse_bytes z = rec_sparse_bytes(m);
        bool part = m->active != NULL;
        w->at = part ? rec_sysmat_sparse(z.at) : rec_sysmat_array(z.at);
        w->w = part ? rec_sysmat_sparse(z.w) : rec_sysmat_array(z.w);
        w->more = rec_sysmat_array(w->n_more * sizeof *w->more);
        if (w->at == NULL || w->w == NULL || w->more == NULL)
            err = PVX_ENOMEM;
        else
            memset(w->w + z.w - REC_WINDOWS_PAD, 0, REC_WINDOWS_PAD);
    }
    if (err == PVX_OK)
        pvx_pool_run(pool, chunks, fill_chunk, &j);
    if (err == PVX_OK && shapes[j.shape].wide == 4)
        pvx_pool_run(pool, chunks, settle_chunk, &j);
    free(j.more);
    return err;
}
