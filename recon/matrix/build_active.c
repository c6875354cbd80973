/* Building what is kept of S (active.h), one camera after the other:
 *   trace    bands of rows of the image, a row of bins at a time (rays.h).  A pair of rows gives one of the next
 *            coarser level, that with its neighbour one of the next: (4) of sysmat.h and its rounding (3) need what
 *            one coarse bin has, and no other.  Of each row the entries in kept columns are put by, then it is
 *            forgotten
 *   columns  what was put by, level by level (columns.h)
 *   footprints
 * then on each level the cameras' columns are merged and made windows.  A thread has two rows of bins of each level at
 * a time.  The result does not depend on how many bands or threads there are. */
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "recon/matrix/columns.h"
#include "recon/matrix/rays.h"

/* Two rows of bins, with all their entries. */
struct pair {
    struct rec_band all;
    size_t *end;   /* [2*bw] of each bin's */
    size_t second; /* where the second row's begin */
};

/* Column and exact value in eighths of the coarse unit. */
struct sum {
    uint32_t col, eighths;
};

/* What one running task needs; there are as many as threads. */
struct scratch {
    atomic_flag in_use;
    struct rec_rays rays;
    struct pair pair[REC_SYSMAT_LEVELS_MAX];
    struct sum *table, *list, *sorted; /* [room] open addressing; what is in it, in order */
    size_t room;
};

struct level {
    rec_sysmat *m;
    struct rec_band_rows rows; /* of the camera in work */
    struct rec_entries part[REC_MAX_CAMERAS];
    uint32_t *
        coarse_row; /* [ny*nz] first column of the coarser level's row that a row of voxels is in */
    double per_nx;
};

struct build {
    const struct rec_rig *rig;
    size_t levels;
    struct level level[REC_SYSMAT_LEVELS_MAX];
    struct rec_tracer t; /* of the camera in work */
    struct scratch *scratch;
    size_t n_scratch;
    _Atomic uint64_t *met; /* [voxels] bits: has entries of the camera */
    size_t camera;
    size_t
        of; /* every so many-th band is traced, and what was met is counted; 0: all, and it is not */
    atomic_uint_fast64_t entries, row_most;
    /* progress */
    pthread_t caller;
    struct rec_progress progress;
    atomic_int rows_done;
    atomic_bool canceled, out_of_memory;
};

static struct scratch *get_scratch(struct build *b)
{
    for (size_t i = 0;; i = (i + 1) % b->n_scratch) /* never more tasks at a time than scratches */
        if (!atomic_flag_test_and_set(&b->scratch[i].in_use))
            return &b->scratch[i];
}

static void tell(struct build *b)
{
    if (b->progress.call == NULL || !pthread_equal(pthread_self(), b->caller))
        return;
    double rows = (double)b->level[0].m->block[b->camera].bh / (double)(b->of > 0 ? b->of : 1);
    double done = atomic_load(&b->rows_done) / rows;
    double cameras = (double)b->camera + 0.9 * (done < 1 ? done : 1);
    if (!b->progress.call(b->progress.ctx, 0.95 * cameras / (double)b->rig->n_cameras))
        atomic_store(&b->canceled, true);
}

/* ---- rows of bins ---- */

static int32_t bins_across(const struct build *b, size_t l)
{
    return b->level[l].m->block[b->camera].bw;
}
static int32_t bins_down(const struct build *b, size_t l)
{
    return b->level[l].m->block[b->camera].bh;
}
/* First entry of bin x in the pair's first or second row. */
static size_t first_of(const struct pair *p, const int32_t *bw, int32_t row, int32_t x)
{
    if (x == 0)
        return row == 0 ? 0 : p->second;
    return p->end[(size_t)row * (size_t)*bw + (size_t)x - 1];
}

/* Row y of level l's kept entries to its band. */
static bool put_by(struct build *b, size_t l, size_t band, const struct pair *p, int32_t y)
{
    struct level *v = &b->level[l];
    struct rec_band *out = &v->rows.band[band];
    const struct rec_active *a = v->m->active;
    const int32_t bw = bins_across(b, l);
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

/* A table for n entries, empty; *mask its size less one. */
static bool new_table(struct scratch *s, size_t n, uint32_t *mask)
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

/* The coarser level's column that a voxel is in. */
static uint32_t parent(const struct level *v, uint32_t col)
{
    uint32_t row = (uint32_t)(int32_t)((col + 0.5) * v->per_nx); /* col / nx, exactly */
    return v->coarse_row[row] + (col - row * (uint32_t)v->m->grid.n[0]) / 2;
}

static void add_entries(const struct level *v, const struct pair *p, size_t from, size_t to,
                        struct sum *table, uint32_t mask)
{
    int shift = __builtin_clz(mask);
    for (size_t e = from; e < to; e++) {
        uint32_t col = parent(v, p->all.col[e]), h = col * 2654435769u >> shift;
        while (table[h].col != col && table[h].col != UINT32_MAX)
            h = (h + 1) & mask;
        if (table[h].col == UINT32_MAX)
            table[h] = (struct sum){col, 0};
        table[h].eighths += p->all.val[e];
    }
}

/* By column, eight bits at a time; the result is s->list. */
static void sort(struct scratch *s, size_t n, uint32_t most)
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
        struct sum *swap = s->list;
        s->list = s->sorted;
        s->sorted = swap;
    }
}

/* The entries of coarse bin x from those of its up to four: in the order of the columns, as coarse.c has it. */
static bool coarse_bin(const struct build *b, struct scratch *s, size_t l, int32_t rows, int32_t x,
                       uint32_t doubled)
{
    const struct level *v = &b->level[l];
    const struct pair *p = &s->pair[l];
    const int32_t bw = bins_across(b, l), last = 2 * x + 1 < bw ? 2 * x + 1 : 2 * x;
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
    sort(s, n, most);
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

/* Level l's pair, of `rows` rows, becomes row y of the next level's. */
static bool coarse_row(const struct build *b, struct scratch *s, size_t l, int32_t rows, int32_t y)
{
    struct pair *to = &s->pair[l + 1];
    const int32_t bw = bins_across(b, l), wide = bins_across(b, l + 1);
    for (int32_t x = 0; x < wide; x++) {
        if (!coarse_bin(b, s, l, rows, x, (uint32_t)(2 * x + 1 == bw) + (uint32_t)(rows == 1)))
            return false;
        to->end[(size_t)(y & 1) * (size_t)wide + (size_t)x] = to->all.n;
    }
    return true;
}

/* Row y of level l is there: put by, and the coarser ones that it completes. */
static bool finish_row(struct build *b, struct scratch *s, size_t band, size_t l, int32_t y)
{
    for (;; l++, y /= 2) {
        struct pair *p = &s->pair[l];
        bool complete = (y & 1) == 1 || y + 1 == bins_down(b, l), coarsest = l + 1 == b->levels;
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

static void meet(struct build *b, const uint32_t *col, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        _Atomic uint64_t *word = &b->met[col[i] / 64];
        uint64_t bit = (uint64_t)1 << col[i] % 64;
        if ((atomic_load_explicit(word, memory_order_relaxed) & bit) == 0)
            atomic_fetch_or_explicit(word, bit, memory_order_relaxed);
    }
}

static bool trace_row(struct build *b, struct scratch *s, int32_t y)
{
    struct pair *p = &s->pair[0];
    for (int32_t x = 0; x < b->t.bw; x++) {
        if (!rec_band_grow(&p->all, b->t.bin_max))
            return false;
        uint32_t *col = p->all.col + p->all.n;
        size_t n = rec_rays_bin(&b->t, &s->rays, x, y, col, p->all.val + p->all.n);
        meet(b, col, n);
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

static void trace_band(void *ctx, size_t task)
{
    struct build *b = ctx;
    struct scratch *s = get_scratch(b);
    size_t band = b->of > 0 ? task * b->of + b->of / 2 : task;
    const struct rec_band *rows = &b->level[0].rows.band[band];
    for (size_t l = 0; l < b->levels; l++) {
        b->level[l].rows.band[band].n = 0;
        s->pair[l].all.n = s->pair[l].second = 0;
    }
    for (int32_t y = rows->row0; y < rows[1].row0; y++) {
        if (atomic_load(&b->canceled) || atomic_load(&b->out_of_memory))
            break;
        if (!trace_row(b, s, y) || !finish_row(b, s, band, 0, y))
            atomic_store(&b->out_of_memory, true);
        atomic_fetch_add(&b->rows_done, 1);
        tell(b);
    }
    atomic_flag_clear(&s->in_use);
}

/* ---- cameras ---- */

static pvx_err no_memory(const struct build *b, uint64_t bytes, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_ENOMEM,
                    "out of memory: the active part of the system matrix needs %llu MiB more for "
                    "camera %s (%zu of %zu); use fewer voxels or a larger binning",
                    (unsigned long long)(bytes >> 20), b->rig->cameras[b->camera].name,
                    b->camera + 1, b->rig->n_cameras);
}

/* Bands of whole rows of the coarsest level. */
static void cut_bands(struct build *b)
{
    size_t tall = (size_t)bins_down(b, b->levels - 1);
    size_t bands = b->of > 0 ? REC_BANDS_MAX : 16 * b->n_scratch;
    bands = bands < REC_BANDS_MAX ? bands : REC_BANDS_MAX;
    bands = bands < tall ? bands : tall;
    for (size_t l = 0; l < b->levels; l++) {
        struct rec_band_rows *r = &b->level[l].rows;
        r->bands = bands;
        r->bw = bins_across(b, l);
        for (size_t k = 0; k <= bands; k++) {
            int32_t row = (int32_t)(tall * k / bands << (b->levels - 1 - l));
            r->band[k].row0 = row < bins_down(b, l) ? row : bins_down(b, l);
        }
    }
}

static bool new_rows(struct build *b)
{
    for (size_t l = 0; l < b->levels; l++) {
        struct rec_band_rows *r = &b->level[l].rows;
        const struct rec_sysmat_block *block = &b->level[l].m->block[b->camera];
        r->bin_n = rec_sysmat_array((size_t)block->bw * (size_t)block->bh * sizeof *r->bin_n);
        if (r->bin_n == NULL)
            return false;
        for (size_t i = 0; i < b->n_scratch; i++) {
            struct pair *p = &b->scratch[i].pair[l];
            free(p->end);
            p->end = pvx_calloc(2 * (size_t)block->bw, sizeof *p->end);
            if (p->end == NULL)
                return false;
        }
    }
    memset((void *)b->met, 0, (rec_grid_count(&b->level[0].m->grid) + 63) / 64 * sizeof *b->met);
    return true;
}

static void free_rows(struct build *b)
{
    for (size_t l = 0; l < b->levels; l++)
        PVX_FREE(b->level[l].rows.bin_n);
}

/* Linux grants memory it does not have and kills whoever uses it: refuse by what is installed. */
static bool fits(const struct build *b)
{
    uint64_t have = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t entries = 0;
    for (size_t l = 0; l < b->levels; l++) {
        entries += 2 * rec_band_entries(&b->level[l].rows);
        for (size_t c = 0; c < b->camera; c++)
            entries += b->level[l].part[c].nnz;
    }
    return entries * REC_ENTRY <= have;
}

/* The bands' entries, of all of them or of a share. */
static pvx_err trace_bands(struct build *b, pvx_pool *pool)
{
    size_t bands = b->level[0].rows.bands;
    atomic_store(&b->rows_done, 0);
    pvx_pool_run(pool, b->of > 0 ? (bands - b->of / 2 + b->of - 1) / b->of : bands, trace_band, b);
    return atomic_load(&b->canceled) ? PVX_ECANCELED : PVX_OK;
}

static pvx_err trace_camera(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    cut_bands(b);
    PVX_TRY(trace_bands(b, pool));
    uint64_t nnz = rec_band_entries(&b->level[0].rows);
    if (atomic_load(&b->out_of_memory) || !fits(b))
        return no_memory(b, nnz * REC_ENTRY, d);
    if (nnz > UINT32_MAX)
        return pvx_fail(
            d, PVX_ERANGE,
            "camera %s: %llu matrix entries of the active part are more than the 2^32-1 of "
            "one matrix; use fewer voxels or a larger binning",
            b->rig->cameras[b->camera].name, (unsigned long long)nnz);
    for (size_t l = 0; l < b->levels; l++) {
        struct level *v = &b->level[l];
        if (rec_columns(&v->rows, rec_sysmat_columns(v->m), pool, &v->part[b->camera]) != PVX_OK)
            return no_memory(b, nnz * REC_ENTRY, d);
        rec_band_rows_free(&v->rows);
    }
    return PVX_OK;
}

static pvx_err build_camera(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    const struct rec_sysmat_block *block = &b->level[0].m->block[b->camera];
    struct rec_entries *part = &b->level[0].part[b->camera];
    size_t rows = (size_t)block->bw * (size_t)block->bh;
    b->t.c = &b->rig->cameras[b->camera];
    b->t.bw = block->bw;
    bool room = rec_rays_new_depth(b->rig, rows, &part->depth) && new_rows(b);
    b->t.depth = part->depth;
    pvx_err e = room ? trace_camera(b, pool, d) : no_memory(b, rows * sizeof(uint32_t), d);
    free_rows(b);
    if (e == PVX_OK && rec_sysmat_active_footprints(b->level[0].m, b->camera, b->t.c, part, b->met,
                                                    pool) != PVX_OK)
        e = no_memory(b, 0, d);
    PVX_FREE(part->depth);
    return e;
}

/* ---- levels ---- */

static pvx_err new_footprints(rec_sysmat *m)
{
    struct rec_sysmat_store *s = m->priv;
    size_t bytes = rec_sparse_bytes(m).fp;
    s->sparse = m->active != NULL;
    for (size_t c = 0; c < m->n_cameras; c++) {
        m->block[c].fp = s->sparse ? pvx_reserve(bytes) : rec_sysmat_array(bytes);
        if (m->block[c].fp == NULL)
            return PVX_ENOMEM;
    }
    return PVX_OK;
}

/* Which coarse rows a level's rows of voxels are in. */
static pvx_err new_parents(struct level *v, const struct rec_grid *coarse)
{
    const struct rec_grid *g = &v->m->grid;
    size_t i = 0;
    v->per_nx = 1.0 / g->n[0];
    v->coarse_row = pvx_calloc((size_t)g->n[1] * (size_t)g->n[2], sizeof *v->coarse_row);
    if (v->coarse_row == NULL)
        return PVX_ENOMEM;
    for (int32_t k = 0; k < g->n[2]; k++)
        for (int32_t j = 0; j < g->n[1]; j++)
            v->coarse_row[i++] = (uint32_t)rec_grid_index(coarse, 0, j / 2, k / 2);
    return PVX_OK;
}

/* A level below the last one, with what it keeps: the coarsest all. */
static pvx_err add_level(struct build *b, bool coarsest)
{
    struct level *v = &b->level[b->levels - 1];
    rec_sysmat *m = v->m;
    PVX_TRY(rec_sysmat_alloc(m->n_cameras, &m->coarse));
    rec_sysmat_coarse_frame(m, m->coarse);
    b->level[b->levels++].m = m->coarse;
    rec_sysmat_window_frame(m->coarse);
    PVX_TRY(new_parents(v, &m->coarse->grid));
    if (!coarsest)
        PVX_TRY(rec_active_coarser(m->active, &m->grid, &m->coarse->grid, &m->coarse->active));
    return new_footprints(m->coarse);
}

static pvx_err set_up(struct build *b, rec_sysmat *finest)
{
    size_t levels = rec_sysmat_levels(&finest->grid);
    b->levels = 1;
    b->level[0].m = finest;
    if (levels == 1) /* the vote looks at all of it */
        memset(finest->active->brick, 1, finest->active->bricks);
    PVX_TRY(rec_active_close(finest->active, &finest->grid));
    PVX_TRY(new_footprints(finest));
    while (b->levels < levels)
        PVX_TRY(add_level(b, b->levels + 1 == levels));
    b->met = pvx_calloc((rec_grid_count(&finest->grid) + 63) / 64, sizeof *b->met);
    b->scratch = pvx_calloc(b->n_scratch, sizeof *b->scratch);
    if (b->met == NULL || b->scratch == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < b->n_scratch; i++)
        PVX_TRY(rec_rays_new(&b->t, &b->scratch[i].rays));
    return PVX_OK;
}

/* All that only the tracing of cameras needs. */
static void free_scratch(struct build *b)
{
    for (size_t i = 0; b->scratch != NULL && i < b->n_scratch; i++) {
        struct scratch *s = &b->scratch[i];
        rec_rays_free(&s->rays);
        for (size_t l = 0; l < b->levels; l++) {
            free(s->pair[l].all.col);
            free(s->pair[l].all.val);
            free(s->pair[l].end);
        }
        free(s->table);
        free(s->list);
        free(s->sorted);
    }
    for (size_t l = 0; l < b->levels; l++) {
        rec_band_rows_free(&b->level[l].rows);
        PVX_FREE(b->level[l].coarse_row);
    }
    PVX_FREE(b->scratch);
    free((void *)b->met);
    b->met = NULL;
}

/* The cameras' columns of a level put together, and their windows. */
static pvx_err finish_level(struct level *v, pvx_pool *pool, struct pvx_diag *d)
{
    struct rec_entries all;
    pvx_err e = rec_sysmat_merge(v->m, v->part, pool, &all, d);
    if (e == PVX_OK)
        e = rec_sysmat_make_windows(v->m, &all, pool, d);
    rec_entries_free(&all);
    return e;
}

static pvx_err build(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    for (; b->camera < b->rig->n_cameras; b->camera++)
        PVX_TRY(build_camera(b, pool, d));
    free_scratch(b);
    for (size_t l = 0; l < b->levels; l++)
        PVX_TRY(finish_level(&b->level[l], pool, d));
    if (b->progress.call != NULL && !b->progress.call(b->progress.ctx, 1))
        return PVX_ECANCELED;
    return PVX_OK;
}

static pvx_err new_build(struct build **out, const struct rec_rig *rig, rec_sysmat *finest,
                         size_t threads, struct rec_progress progress)
{
    struct rec_sysmat_params p = {finest->binning, finest->rays_per_bin};
    struct build *b = *out = pvx_calloc(1, sizeof *b);
    if (b == NULL)
        return PVX_ENOMEM;
    b->rig = rig;
    b->caller = pthread_self();
    b->progress = progress;
    b->n_scratch = threads;
    rec_tracer_init(&b->t, rig, &p);
    return set_up(b, finest);
}
static void free_build(struct build **bp)
{
    struct build *b = *bp;
    if (b == NULL)
        return;
    free_scratch(b);
    for (size_t l = 0; l < b->levels; l++)
        for (size_t c = 0; c < b->rig->n_cameras; c++)
            rec_entries_free(&b->level[l].part[c]);
    PVX_FREE(*bp);
}
static pvx_err say(pvx_err e, struct pvx_diag *d)
{
    if (e == PVX_ECANCELED)
        pvx_fail(d, e, "stopped while building the system matrix");
    return e;
}

pvx_err rec_sysmat_build_active(const struct rec_rig *rig, rec_sysmat **outline, pvx_pool *pool,
                                struct rec_progress progress, rec_sysmat **out, struct pvx_diag *d)
{
    rec_sysmat *m = *outline;
    struct build *b;
    *outline = *out = NULL;
    pvx_err e = new_build(&b, rig, m, pvx_pool_threads(pool), progress);
    if (e != PVX_OK)
        pvx_fail(d, e, "out of memory for the active part of the system matrix");
    else
        e = say(build(b, pool, d), d);
    free_build(&b);
    if (e != PVX_OK)
        rec_sysmat_free(&m);
    *out = m;
    return e;
}

/* ---- what it would take ---- */

#define PAGE 4096
#define MORE_BINS \
    4 /* in a window that is not a column's first, mean; fewer make no difference to what they fill */

static uint64_t pages_of(const struct rec_active *a, size_t bytes)
{
    uint64_t n = 0, next = 0;
    for (size_t i = 0; i < a->columns; i++) {
        uint64_t first = a->column[i] * bytes / PAGE,
                 last = ((a->column[i] + 1) * bytes - 1) / PAGE;
        first = first > next ? first : next;
        n += last >= first ? last - first + 1 : 0;
        next = last + 1;
    }
    return n * PAGE;
}

static uint64_t pages_of_footprints(const struct rec_active *a)
{
    uint64_t n = 0, next = 0;
    for (size_t i = 0; i < a->bricks; i++) {
        uint64_t page = i * REC_BRICK_VOXELS * sizeof(struct rec_rect) / PAGE;
        n += a->brick[i] && page >= next;
        next = a->brick[i] ? page + 1 : next;
    }
    return n * PAGE;
}

/* A level's bytes, without further windows. */
static uint64_t stored(const rec_sysmat *m, size_t window)
{
    size_t slots = (size_t)m->win.slots, of_column = slots * (sizeof *m->win.at + window);
    size_t voxels = rec_grid_count(&m->grid);
    const struct rec_active *a = m->active;
    if (a == NULL)
        return voxels * of_column + rec_sparse_bytes(m).fp * m->n_cameras;
    return pages_of(a, slots * sizeof *m->win.at) + pages_of(a, slots * window) +
           pages_of_footprints(a) * m->n_cameras +
           a->bricks * (1 + sizeof(struct rec_rect) * m->n_cameras) +
           voxels / 64 * (sizeof *a->bits + sizeof *a->rank) + a->columns * sizeof *a->column;
}

/* Entries come in a band, whose room grows by half, then in columns; those of all cameras, then merged, slice by
 * slice; and while windows are made of them. */
static void add_up(const struct build *b, double kept_most, struct rec_active_estimate *o)
{
    double entries = o->kept * REC_ENTRY, windows = 0, columns = 0, first = 0;
    double rows = 2 * 1.34 * 1.5 * (double)atomic_load(&b->row_most) * REC_ENTRY;
    /* up to so many a voxel and camera fit 3x4 bins, that of the next voxel as well */
    o->window =
        o->entries <= 6.0 * (double)b->rig->n_cameras * (double)rec_grid_count(&b->rig->grid)
            ? 12
            : REC_WINDOW_MAX;
    for (size_t l = 0; l < b->levels; l++) {
        const rec_sysmat *m = b->level[l].m;
        o->stored += stored(m, o->window);
        columns += (double)rec_sysmat_columns(m);
        first += (double)rec_sysmat_columns(m) * (double)m->n_cameras;
    }
    windows = (o->kept - first) / MORE_BINS * sizeof(struct rec_more);
    o->stored += windows > 0 ? (uint64_t)windows : 0;
    columns *= (double)(b->rig->n_cameras + 1 + b->n_scratch) * sizeof(uint32_t);
    o->building = o->stored +
                  (uint64_t)(1.1 * entries + 2.5 * kept_most * REC_ENTRY + columns +
                             rows * (double)b->n_scratch) +
                  rec_grid_count(&b->level[0].m->grid) / 8;
}

static pvx_err estimate(struct build *b, double share, pvx_pool *pool,
                        struct rec_active_estimate *o)
{
    double kept_most = 0;
    for (; b->camera < b->rig->n_cameras; b->camera++) {
        const struct rec_sysmat_block *block = &b->level[0].m->block[b->camera];
        size_t bins = (size_t)block->bw * (size_t)block->bh, traced = 0;
        int64_t t0 = pvx_now_mono();
        struct rec_entries *part = &b->level[0].part[b->camera];
        b->t.c = &b->rig->cameras[b->camera];
        b->t.bw = block->bw;
        if (!rec_rays_new_depth(b->rig, bins, &part->depth) || !new_rows(b))
            return PVX_ENOMEM;
        b->t.depth = part->depth;
        b->of = 1;
        cut_bands(b);
        double bands = (double)b->level[0].rows.bands;
        b->of = share * bands < 1 ? (size_t)bands : (size_t)(1 / share);
        uint64_t before = atomic_load(&b->entries);
        pvx_err e = trace_bands(b, pool);
        free_rows(b);
        PVX_FREE(part->depth);
        if (e != PVX_OK || atomic_load(&b->out_of_memory))
            return e != PVX_OK ? e : PVX_ENOMEM;
        const struct rec_band_rows *r = &b->level[0].rows;
        for (size_t k = b->of / 2; k < r->bands; k += b->of)
            traced += (size_t)(r->band[k + 1].row0 - r->band[k].row0) * (size_t)block->bw;
        double by = (double)bins / (double)traced, kept = 0;
        for (size_t l = 0; l < b->levels; l++) {
            kept += by * (double)rec_band_entries(&b->level[l].rows);
            rec_band_rows_free(&b->level[l].rows);
        }
        kept_most = kept > kept_most ? kept : kept_most;
        o->kept += kept;
        o->bins += bins;
        o->entries += by * (double)(atomic_load(&b->entries) - before);
        o->seconds += by * (double)(pvx_now_mono() - t0) * 1e-9;
    }
    add_up(b, kept_most, o);
    return PVX_OK;
}

/* The outline again, with its marks, to be thrown away. */
static pvx_err copy_outline(const struct rec_rig *rig, const rec_sysmat *outline, rec_sysmat **out,
                            struct pvx_diag *d)
{
    struct rec_sysmat_params p = {outline->binning, outline->rays_per_bin};
    PVX_TRY(rec_sysmat_alloc(rig->n_cameras, out));
    pvx_err e = rec_sysmat_finest_frame(rig, &p, *out, d);
    rec_sysmat_window_frame(*out);
    if (e == PVX_OK)
        e = rec_active_new(&outline->grid, &(*out)->active);
    if (e == PVX_OK)
        memcpy((*out)->active->brick, outline->active->brick, outline->active->bricks);
    else
        rec_sysmat_free(out);
    return e;
}

pvx_err rec_sysmat_estimate_active(const struct rec_rig *rig, const rec_sysmat *outline,
                                   double share, pvx_pool *pool, struct rec_progress progress,
                                   struct rec_active_estimate *out, struct pvx_diag *d)
{
    rec_sysmat *m;
    struct build *b = NULL;
    *out = (struct rec_active_estimate){0};
    PVX_TRY(copy_outline(rig, outline, &m, d));
    pvx_err e = new_build(&b, rig, m, pvx_pool_threads(pool), progress);
    if (e == PVX_OK) {
        e = estimate(b, share < 1 ? share : 1, pool, out);
        out->columns = m->active->columns;
    }
    free_build(&b);
    rec_sysmat_free(&m);
    if (e == PVX_ENOMEM)
        pvx_fail(d, e, "out of memory while the system matrix is estimated");
    return say(e, d);
}
