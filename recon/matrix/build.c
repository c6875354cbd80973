/* Building S, one camera after the other:
 *   trace    bands of rows of the image; the rays of a bin are walked, each to the first body of the rig,
 *            and its entries rounded and
 *            written one after the other, bin after bin
 *   count    strips of bands of about as many entries: entries per column
 *   sum      colptr, and where each strip's entries of a column start
 *   fill     the strips again: every entry to its column
 * then the cameras' columns are merged and the coarser levels added.
 * No two tasks write to one place, and the rows of a column ascend because strips and bins do, so the
 * result does not depend on how many bands, strips or threads there are. */
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/mem.h"
#include "recon/matrix/priv.h"
#include "recon/geom/traverse.h"

#define CHUNK      65536 /* columns per task while summing */
#define STRIPS_MAX 16
#define BANDS_MAX  256
#define ENTRY      (sizeof(uint32_t) + sizeof(uint8_t))

/* What one running task needs; there are as many as threads. */
struct scratch {
    atomic_flag in_use;
    int32_t *index; /* of one ray */
    float *value;
    /* Merging the rays of a bin: open addressing by voxel, emptied by starting a new epoch. */
    struct slot {
        int32_t index;
        uint32_t epoch;
        double sum;
    } * slot;
    uint32_t *order; /* slots in the order of their first ray */
    uint32_t epoch;
};

/* Entries of some rows of an image, row by row. */
struct band {
    uint32_t *col;
    uint8_t *val;
    size_t n, room;
};

struct build {
    const struct rec_rig *rig;
    rec_sysmat *m;
    size_t N;
    int32_t binning, rays;
    double per_unit; /* 1 / m->unit */
    size_t bin_max;  /* entries of a bin, at most */
    unsigned slot_bits;
    struct scratch *scratch;
    size_t n_scratch;
    struct band band[BANDS_MAX];
    struct rec_entries *part; /* [cameras] */
    /* the camera in work */
    size_t camera;
    const struct rec_camera *c;
    int32_t bw, bh;
    size_t bands, strips;
    size_t strip[STRIPS_MAX + 1]; /* their first bands */
    uint32_t *bin_n;              /* [bh*bw] entries of each bin */
    uint32_t *at;                 /* [strips][N] counts, then the next free place */
    uint64_t *chunk;              /* entries of CHUNK columns, then of all before them */
    /* progress */
    pthread_t caller;
    rec_progress_fn progress;
    void *ctx;
    atomic_int rows_done;
    atomic_bool canceled, out_of_memory;
};

static struct scratch *get_scratch(struct build *b)
{
    for (size_t i = 0;; i = (i + 1) % b->n_scratch) /* never more tasks at a time than scratches */
        if (!atomic_flag_test_and_set(&b->scratch[i].in_use))
            return &b->scratch[i];
}

/* Entries of sub-ray (i,j) of bin (x,y) in s->index, s->value. */
static size_t trace(const struct build *b, struct scratch *s, int32_t x, int32_t y, int32_t i,
                    int32_t j)
{
    double o[3], d[3], step = (double)b->binning / b->rays;
    double u = (double)x * b->binning - 0.5 + (i + 0.5) * step;
    double v = (double)y * b->binning - 0.5 + (j + 0.5) * step;
    if (!rec_camera_ray(b->c, u, v, o, d)) /* the lens does not reach here: sees nothing */
        return 0;
    double end = INFINITY;
    float *depth = b->part[b->camera].depth;
    if (depth != NULL) {
        end = rec_body_hit(&b->rig->bodies, o, d);
        float *bin = &depth[(size_t)y * (size_t)b->bw + (size_t)x];
        *bin = end < *bin ? (float)end : *bin;
    }
    return rec_traverse_until(&b->m->grid, o, d, end, s->index, s->value);
}

/* Add a ray to the bin's table; `used` slots so far. */
static size_t merge(const struct build *b, struct scratch *s, size_t n, size_t used)
{
    uint32_t mask = (1u << b->slot_bits) - 1;
    for (size_t i = 0; i < n; i++) {
        uint32_t h = (uint32_t)s->index[i] * 2654435769u >> (32 - b->slot_bits);
        while (s->slot[h].epoch == s->epoch && s->slot[h].index != s->index[i])
            h = (h + 1) & mask;
        struct slot *slot = &s->slot[h];
        if (slot->epoch != s->epoch) {
            *slot = (struct slot){s->index[i], s->epoch, 0};
            s->order[used++] = h;
        }
        slot->sum += s->value[i];
    }
    return used;
}

/* The running sum of a row, rounded: sysmat.h (3). */
struct row {
    double sum; /* in units, and 1/2 */
    int64_t done;
};

static inline size_t put(struct band *out, size_t n, struct row *r, int32_t index, double units)
{
    r->sum += units;
    int64_t now = (int64_t)r->sum, q = now - r->done;
    q = q < UINT8_MAX ? q : UINT8_MAX;
    r->done += q;
    out->col[n] = (uint32_t)index;
    out->val[n] = (uint8_t)q;
    return n + (q > 0);
}

static size_t bin_of_one(const struct build *b, struct scratch *s, int32_t x, int32_t y,
                         struct band *out)
{
    struct row r = {0.5, 0};
    size_t n = out->n, traced = trace(b, s, x, y, 0, 0);
    for (size_t i = 0; i < traced; i++)
        n = put(out, n, &r, s->index[i], s->value[i] * b->per_unit);
    return n - out->n;
}

static size_t bin_of_many(const struct build *b, struct scratch *s, int32_t x, int32_t y,
                          struct band *out)
{
    size_t used = 0, n = out->n;
    if (++s->epoch == 0) {
        memset(s->slot, 0, sizeof *s->slot << b->slot_bits);
        s->epoch = 1;
    }
    for (int32_t j = 0; j < b->rays; j++)
        for (int32_t i = 0; i < b->rays; i++)
            used = merge(b, s, trace(b, s, x, y, i, j), used);
    double share = b->per_unit / (b->rays * b->rays);
    struct row r = {0.5, 0};
    for (size_t i = 0; i < used; i++) {
        const struct slot *slot = &s->slot[s->order[i]];
        n = put(out, n, &r, slot->index, slot->sum * share);
    }
    return n - out->n;
}

static void tell(struct build *b)
{
    if (b->progress == NULL || !pthread_equal(pthread_self(), b->caller))
        return;
    double cameras = (double)b->camera + 0.9 * atomic_load(&b->rows_done) / b->bh;
    if (!b->progress(b->ctx, 0.95 * cameras / (double)b->rig->n_cameras))
        atomic_store(&b->canceled, true);
}

/* Room for one more bin. */
static bool grow(const struct build *b, struct band *out)
{
    if (out->room - out->n > b->bin_max)
        return true;
    size_t room = out->room + out->room / 2 + b->bin_max + 65536;
    uint32_t *col = realloc(out->col, room * sizeof *col);
    if (col != NULL)
        out->col = col;
    uint8_t *val = realloc(out->val, room * sizeof *val);
    if (val != NULL)
        out->val = val;
    if (col == NULL || val == NULL)
        return false;
    out->room = room;
    return true;
}

static int32_t first_row(const struct build *b, size_t band)
{
    return (int32_t)((size_t)b->bh * band / b->bands);
}

static void trace_band(void *ctx, size_t task)
{
    struct build *b = ctx;
    struct scratch *s = get_scratch(b);
    struct band *out = &b->band[task];
    out->n = 0;
    for (int32_t y = first_row(b, task); y < first_row(b, task + 1); y++) {
        if (atomic_load(&b->canceled) || atomic_load(&b->out_of_memory))
            break;
        for (int32_t x = 0; x < b->bw; x++) {
            if (!grow(b, out)) {
                atomic_store(&b->out_of_memory, true);
                break;
            }
            size_t n = b->rays == 1 ? bin_of_one(b, s, x, y, out) : bin_of_many(b, s, x, y, out);
            b->bin_n[(size_t)y * (size_t)b->bw + (size_t)x] = (uint32_t)n;
            out->n += n;
        }
        atomic_fetch_add(&b->rows_done, 1);
        tell(b);
    }
    atomic_flag_clear(&s->in_use);
}

static void count_strip(void *ctx, size_t task)
{
    struct build *b = ctx;
    uint32_t *at = b->at + task * b->N;
    memset(at, 0, b->N * sizeof *at);
    for (size_t k = b->strip[task]; k < b->strip[task + 1]; k++)
        for (size_t i = 0; i < b->band[k].n; i++)
            at[b->band[k].col[i]]++;
}

static size_t chunk_end(const struct build *b, size_t task)
{
    return (task + 1) * CHUNK < b->N ? (task + 1) * CHUNK : b->N;
}

static void sum_chunk(void *ctx, size_t task)
{
    struct build *b = ctx;
    uint64_t sum = 0;
    for (size_t strip = 0; strip < b->strips; strip++)
        for (size_t j = task * CHUNK; j < chunk_end(b, task); j++)
            sum += b->at[strip * b->N + j];
    b->chunk[task] = sum;
}

static void place_chunk(void *ctx, size_t task)
{
    struct build *b = ctx;
    uint32_t next = (uint32_t)b->chunk[task], *colptr = b->part[b->camera].colptr;
    for (size_t j = task * CHUNK; j < chunk_end(b, task); j++) {
        colptr[j] = next;
        for (size_t strip = 0; strip < b->strips; strip++) {
            uint32_t n = b->at[strip * b->N + j];
            b->at[strip * b->N + j] = next;
            next += n;
        }
    }
}

static void fill_strip(void *ctx, size_t task)
{
    struct build *b = ctx;
    uint32_t *at = b->at + task * b->N, *row = b->part[b->camera].row;
    uint8_t *val = b->part[b->camera].val;
    for (size_t k = b->strip[task]; k < b->strip[task + 1]; k++) {
        const struct band *in = &b->band[k];
        uint32_t end = (uint32_t)(first_row(b, k + 1) * b->bw);
        size_t i = 0;
        for (uint32_t r = (uint32_t)(first_row(b, k) * b->bw); r < end; r++)
            for (size_t last = i + b->bin_n[r]; i < last; i++) {
                uint32_t e = at[in->col[i]]++;
                row[e] = r;
                val[e] = in->val[i];
            }
    }
}

static pvx_err no_memory(const struct build *b, uint64_t bytes, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_ENOMEM,
                    "out of memory: the system matrix needs %llu MiB more for camera %s (%zu of "
                    "%zu); use fewer voxels, a larger binning, fewer cameras, or the box basis",
                    (unsigned long long)(bytes >> 20), b->c->name, b->camera + 1,
                    b->rig->n_cameras);
}

/* Linux grants memory it does not have and kills whoever uses it: refuse by what is installed. */
static bool fits(const struct build *b, uint64_t more)
{
    uint64_t have = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t used = 0;
    for (size_t i = 0; i < b->camera; i++)
        used += b->N * (sizeof(struct rec_rect) + sizeof(uint32_t)) + b->part[i].nnz * ENTRY;
    for (size_t k = 0; k < b->bands; k++)
        used += b->band[k].n * ENTRY;
    return used + more <= have;
}

/* Bands -> strips of about as many entries each; the entries in all. */
static uint64_t cut_strips(struct build *b)
{
    uint64_t total = 0, sum = 0;
    size_t s = 0;
    for (size_t k = 0; k < b->bands; k++)
        total += b->band[k].n;
    for (size_t k = 0; k < b->bands; k++) {
        while (s < b->strips && sum * b->strips >= total * s)
            b->strip[s++] = k;
        sum += b->band[k].n;
    }
    while (s <= b->strips)
        b->strip[s++] = b->bands;
    return total;
}

static pvx_err trace_camera(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    struct rec_entries *out = &b->part[b->camera];
    pvx_pool_run(pool, b->bands, trace_band, b);
    if (atomic_load(&b->canceled))
        return PVX_ECANCELED;
    out->nnz = cut_strips(b);
    if (atomic_load(&b->out_of_memory) || !fits(b, out->nnz * ENTRY))
        return no_memory(b, out->nnz * ENTRY, d);
    if (out->nnz > UINT32_MAX)
        return pvx_fail(
            d, PVX_ERANGE,
            "camera %s: %llu matrix entries are more than the 2^32-1 of one matrix; use "
            "fewer voxels or a larger binning",
            b->c->name, (unsigned long long)out->nnz);
    out->row = rec_sysmat_array(out->nnz * sizeof *out->row);
    out->val = rec_sysmat_array(out->nnz * sizeof *out->val);
    if (out->row == NULL || out->val == NULL)
        return no_memory(b, out->nnz * ENTRY, d);
    size_t chunks = (b->N + CHUNK - 1) / CHUNK;
    uint64_t total = 0;
    pvx_pool_run(pool, b->strips, count_strip, b);
    pvx_pool_run(pool, chunks, sum_chunk, b);
    for (size_t i = 0; i < chunks; i++) {
        uint64_t n = b->chunk[i];
        b->chunk[i] = total;
        total += n;
    }
    pvx_pool_run(pool, chunks, place_chunk, b);
    out->colptr[b->N] = (uint32_t)total;
    pvx_pool_run(pool, b->strips, fill_strip, b);
    return PVX_OK;
}

/* Where bodies end the rays of each bin; none: nothing. */
static bool new_depth(const struct build *b, size_t rows, float **out)
{
    if (b->rig->bodies.n == 0)
        return true;
    *out = rec_sysmat_array(rows * sizeof **out);
    for (size_t i = 0; *out != NULL && i < rows; i++)
        (*out)[i] = INFINITY;
    return *out != NULL;
}

static pvx_err build_camera(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    struct rec_sysmat_block *block = &b->m->block[b->camera];
    struct rec_entries *out = &b->part[b->camera];
    size_t rows = (size_t)block->bw * (size_t)block->bh;
    b->bw = block->bw;
    b->bh = block->bh;
    /* rays in the middle of an image are longer: many bands even that out */
    b->bands = b->n_scratch == 1 ? 1 : 16 * b->n_scratch;
    b->bands = b->bands < BANDS_MAX ? b->bands : BANDS_MAX;
    b->bands = b->bands < (size_t)b->bh ? b->bands : (size_t)b->bh;
    atomic_store(&b->rows_done, 0);
    out->colptr = rec_sysmat_array((b->N + 1) * sizeof *out->colptr);
    struct rec_rect *fp = rec_sysmat_array(rec_brick_places(&b->m->grid) * sizeof *fp);
    block->fp = fp;
    b->bin_n = rec_sysmat_array(rows * sizeof *b->bin_n);
    bool room = new_depth(b, rows, &out->depth);
    pvx_err e = out->colptr == NULL || fp == NULL || b->bin_n == NULL || !room
                    ? no_memory(b, b->N * (sizeof *fp + sizeof *out->colptr), d)
                    : trace_camera(b, pool, d);
    PVX_FREE(b->bin_n);
    PVX_TRY(e);
    if (rec_sysmat_footprints(b->m, b->c, block, out, pool, fp) != PVX_OK)
        return no_memory(b, 0, d);
    PVX_FREE(out->depth);
    return PVX_OK;
}

static bool new_scratch(struct build *b)
{
    size_t max = rec_traverse_max(&b->m->grid);
    b->scratch = pvx_calloc(b->n_scratch, sizeof *b->scratch);
    if (b->scratch == NULL)
        return false;
    b->bin_max = max * (size_t)(b->rays * b->rays);
    for (b->slot_bits = 4; (size_t)1 << b->slot_bits < 2 * b->bin_max;)
        b->slot_bits++;
    for (size_t i = 0; i < b->n_scratch; i++) {
        struct scratch *s = &b->scratch[i];
        s->index = pvx_calloc(max, sizeof *s->index);
        s->value = pvx_calloc(max, sizeof *s->value);
        if (s->index == NULL || s->value == NULL)
            return false;
        if (b->rays == 1)
            continue;
        s->slot = pvx_calloc((size_t)1 << b->slot_bits, sizeof *s->slot);
        s->order = pvx_calloc(b->bin_max, sizeof *s->order);
        if (s->slot == NULL || s->order == NULL)
            return false;
    }
    return true;
}

/* All that only the tracing of cameras needs. */
static void free_scratch(struct build *b)
{
    for (size_t i = 0; b->scratch != NULL && i < b->n_scratch; i++) {
        free(b->scratch[i].index);
        free(b->scratch[i].value);
        free(b->scratch[i].slot);
        free(b->scratch[i].order);
    }
    for (size_t k = 0; k < BANDS_MAX; k++) {
        free(b->band[k].col);
        free(b->band[k].val);
    }
    free(b->scratch);
    free(b->at);
    free(b->chunk);
}

static pvx_err build_cameras(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    b->c = &b->rig->cameras[0];
    b->strips = b->n_scratch < STRIPS_MAX ? b->n_scratch : STRIPS_MAX;
    b->at = rec_sysmat_array(b->strips * b->N * sizeof *b->at);
    b->chunk = pvx_calloc((b->N + CHUNK - 1) / CHUNK, sizeof *b->chunk);
    if (b->at == NULL || b->chunk == NULL || !new_scratch(b))
        return no_memory(b, b->strips * b->N * sizeof *b->at, d);
    for (b->camera = 0; b->camera < b->rig->n_cameras; b->camera++) {
        b->c = &b->rig->cameras[b->camera];
        PVX_TRY(build_camera(b, pool, d));
    }
    return PVX_OK;
}

/* Bodies that leave no camera a ray in the volume. */
static pvx_err all_hidden(const struct build *b, struct pvx_diag *d)
{
    for (size_t c = 0; c < b->rig->n_cameras; c++)
        if (b->part[c].nnz > 0)
            return PVX_OK;
    return pvx_fail(
        d, PVX_EINVAL,
        "bodies of the rig hide the whole volume from all cameras (the first is '%s'): are "
        "they where they are in the lab, in metres?",
        b->rig->bodies.body[0].name);
}

static pvx_err build_all(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    rec_sysmat *m = b->m;
    for (size_t c = 0; c < m->n_cameras; c++) {
        m->block[c].bw = b->rig->cameras[c].width / b->binning;
        m->block[c].bh = b->rig->cameras[c].height / b->binning;
    }
    PVX_TRY(rec_sysmat_number_rows(m, d));
    b->part = pvx_calloc(m->n_cameras, sizeof *b->part);
    pvx_err e = b->part == NULL ? PVX_ENOMEM : build_cameras(b, pool, d);
    free_scratch(b);
    if (e == PVX_OK && b->rig->bodies.n > 0)
        e = all_hidden(b, d);
    struct rec_entries all = {0};
    if (e == PVX_OK)
        e = rec_sysmat_merge(m, b->part, pool, &all, d);
    for (size_t c = 0; b->part != NULL && c < m->n_cameras; c++)
        rec_entries_free(&b->part[c]);
    free(b->part);
    if (e == PVX_OK)
        e = rec_sysmat_add_levels(m, &all, pool, d);
    rec_entries_free(&all);
    if (e == PVX_OK && b->progress != NULL && !b->progress(b->ctx, 1))
        e = PVX_ECANCELED;
    return e;
}

pvx_err rec_sysmat_build(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                         pvx_pool *pool, rec_progress_fn progress, void *ctx, rec_sysmat **out,
                         struct pvx_diag *d)
{
    struct rec_sysmat_params r;
    struct build b = {.rig = rig,
                      .N = rec_grid_count(&rig->grid),
                      .caller = pthread_self(),
                      .progress = progress,
                      .ctx = ctx,
                      .n_scratch = pvx_pool_threads(pool)};
    *out = NULL;
    PVX_TRY(rec_sysmat_resolve(rig, p, &r, d));
    PVX_TRY(rec_sysmat_alloc(rig->n_cameras, &b.m));
    pvx_err e = rec_sysmat_key(rig, &r, &b.m->key, d);
    b.m->grid = rig->grid;
    b.m->unit = rec_sysmat_unit(&rig->grid);
    b.per_unit = 1.0 / b.m->unit;
    b.m->binning = b.binning = r.binning;
    b.m->rays_per_bin = b.rays = r.rays_per_bin;
    if (e == PVX_OK)
        e = build_all(&b, pool, d);
    if (e == PVX_ECANCELED)
        pvx_fail(d, e, "stopped while building the system matrix");
    if (e != PVX_OK) {
        rec_sysmat_free(&b.m);
        return e;
    }
    *out = b.m;
    return PVX_OK;
}
