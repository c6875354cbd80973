/* Building S, one camera after the other.  The image is cut into bands of rows; every task walks the
 * rays of one band:
 *   count   entries per column and band
 *   sum     colptr, and where each band's entries of a column start
 *   fill    walk the rays again and write the entries where they belong
 * No two tasks write to one place, and the rows of a column ascend because bands and rays do, so the
 * result does not depend on how many bands or threads there are. */
#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/mem.h"
#include "recon/sysmat_priv.h"
#include "recon/traverse.h"

#define CHUNK      65536               /* columns per task while summing */
#define COUNTS_MAX ((size_t)512 << 20) /* bytes of band counters at most */
#define RAYS_MAX   ((size_t)256 << 20) /* bytes of ray directions kept between the two walks */
#define HUGE_PAGE  ((size_t)2 << 20)

/* What one running task needs; there are as many as threads. */
struct scratch {
    atomic_flag taken;
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

struct build {
    const struct rec_rig *rig;
    rec_sysmat *m;
    size_t N;
    int32_t binning, rays;
    unsigned slot_bits;
    struct scratch *scratch;
    size_t n_scratch;
    /* the camera in work */
    size_t camera;
    const struct rec_camera *c;
    int32_t bw, bh;
    size_t bands, max_bands;
    uint32_t *at;     /* [bands][N] counts, then the next free place */
    uint64_t *chunk;  /* entries of CHUNK columns, then of all before them */
    double (*ray)[3]; /* directions of all rays of the camera, or NULL: unprojected twice */
    uint32_t *colptr;
    uint32_t *row; /* NULL while counting */
    float *val;
    /* progress */
    pthread_t caller;
    rec_progress_fn progress;
    void *ctx;
    atomic_int rows_done;
    atomic_bool canceled;
};

static struct scratch *take_scratch(struct build *b)
{
    for (size_t i = 0;; i = (i + 1) % b->n_scratch) /* never more tasks at a time than scratches */
        if (!atomic_flag_test_and_set(&b->scratch[i].taken))
            return &b->scratch[i];
}

/* Entries of sub-ray (i,j) of bin (x,y) in s->index, s->value. */
static size_t trace(const struct build *b, struct scratch *s, int32_t x, int32_t y, int32_t i,
                    int32_t j)
{
    double o[3], fresh[3] = {0, 0, 0};
    double *d = fresh;
    if (b->ray != NULL)
        d = b->ray[((size_t)y * (size_t)b->bw + (size_t)x) * (size_t)(b->rays * b->rays) +
                   (size_t)(j * b->rays + i)];
    if (b->ray == NULL || b->row == NULL) {
        double step = (double)b->binning / b->rays;
        double u = (double)x * b->binning - 0.5 + (i + 0.5) * step;
        double v = (double)y * b->binning - 0.5 + (j + 0.5) * step;
        if (!rec_camera_ray(b->c, u, v, o, d)) /* the lens does not reach here: sees nothing */
            d[0] = d[1] = d[2] = 0;
    }
    rec_camera_centre(b->c, o);
    return rec_traverse(&b->m->grid, o, d, s->index, s->value);
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

static inline void put(const struct build *b, uint32_t *at, uint32_t row, int32_t index, float v)
{
    uint32_t e = at[index]++;
    if (b->row != NULL) {
        b->row[e] = row;
        b->val[e] = v;
    }
}

static void bin_of_one(const struct build *b, struct scratch *s, int32_t x, int32_t y, uint32_t *at)
{
    uint32_t row = (uint32_t)(y * b->bw + x);
    size_t n = trace(b, s, x, y, 0, 0);
    if (b->row == NULL)
        for (size_t i = 0; i < n; i++)
            at[s->index[i]]++;
    else
        for (size_t i = 0; i < n; i++)
            put(b, at, row, s->index[i], s->value[i]);
}

static void bin_of_many(const struct build *b, struct scratch *s, int32_t x, int32_t y,
                        uint32_t *at)
{
    size_t used = 0;
    uint32_t row = (uint32_t)(y * b->bw + x);
    if (++s->epoch == 0) {
        memset(s->slot, 0, sizeof *s->slot << b->slot_bits);
        s->epoch = 1;
    }
    for (int32_t j = 0; j < b->rays; j++)
        for (int32_t i = 0; i < b->rays; i++)
            used = merge(b, s, trace(b, s, x, y, i, j), used);
    double share = 1.0 / (b->rays * b->rays);
    for (size_t i = 0; i < used; i++) {
        const struct slot *slot = &s->slot[s->order[i]];
        float v = (float)(slot->sum * share);
        if (v >= FLT_MIN)
            put(b, at, row, slot->index, v);
    }
}

static void tell(struct build *b)
{
    if (b->progress == NULL || !pthread_equal(pthread_self(), b->caller))
        return;
    double cameras = (double)b->camera + 0.5 * atomic_load(&b->rows_done) / b->bh;
    if (!b->progress(b->ctx, 0.999 * cameras / (double)b->rig->n_cameras))
        atomic_store(&b->canceled, true);
}

static void trace_band(void *ctx, size_t task)
{
    struct build *b = ctx;
    struct scratch *s = take_scratch(b);
    uint32_t *at = b->at + task * b->N;
    int32_t y0 = (int32_t)((size_t)b->bh * task / b->bands);
    int32_t y1 = (int32_t)((size_t)b->bh * (task + 1) / b->bands);
    for (int32_t y = y0; y < y1 && !atomic_load(&b->canceled); y++) {
        for (int32_t x = 0; x < b->bw; x++) {
            if (b->rays == 1)
                bin_of_one(b, s, x, y, at);
            else
                bin_of_many(b, s, x, y, at);
        }
        atomic_fetch_add(&b->rows_done, 1);
        tell(b);
    }
    atomic_flag_clear(&s->taken);
}

static void clear_band(void *ctx, size_t task)
{
    struct build *b = ctx;
    memset(b->at + task * b->N, 0, b->N * sizeof *b->at);
}

static size_t chunk_end(const struct build *b, size_t task)
{
    return (task + 1) * CHUNK < b->N ? (task + 1) * CHUNK : b->N;
}

static void sum_chunk(void *ctx, size_t task)
{
    struct build *b = ctx;
    uint64_t sum = 0;
    for (size_t band = 0; band < b->bands; band++)
        for (size_t j = task * CHUNK; j < chunk_end(b, task); j++)
            sum += b->at[band * b->N + j];
    b->chunk[task] = sum;
}

static void place_chunk(void *ctx, size_t task)
{
    struct build *b = ctx;
    uint32_t next = (uint32_t)b->chunk[task];
    for (size_t j = task * CHUNK; j < chunk_end(b, task); j++) {
        b->colptr[j] = next;
        for (size_t band = 0; band < b->bands; band++) {
            uint32_t n = b->at[band * b->N + j];
            b->at[band * b->N + j] = next;
            next += n;
        }
    }
}

/* `bytes` from the heap, on huge pages where the system gives them: S is read column by column in
 * any order, which is what small pages are slow at. */
static void *allocate(uint64_t bytes)
{
    size_t align = bytes >= 2 * HUGE_PAGE ? HUGE_PAGE : PVX_ALIGN;
    if (bytes > SIZE_MAX / 2)
        return NULL;
    void *p = aligned_alloc(align, ((size_t)bytes + align) & ~(align - 1));
    if (p != NULL && align == HUGE_PAGE)
        madvise(p, (size_t)bytes, MADV_HUGEPAGE); /* a wish; refusing it changes nothing */
    return p;
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
    for (size_t i = 0; i < b->camera; i++) {
        uint64_t bytes[4];
        rec_sysmat_section_bytes(b->m, &b->m->block[i], bytes);
        used += bytes[0] + bytes[1] + bytes[2] + bytes[3];
    }
    return used + more <= have;
}

static pvx_err sum_up(struct build *b, pvx_pool *pool, uint64_t *nnz, struct pvx_diag *d)
{
    size_t chunks = (b->N + CHUNK - 1) / CHUNK;
    uint64_t total = 0;
    pvx_pool_run(pool, chunks, sum_chunk, b);
    for (size_t i = 0; i < chunks; i++) {
        uint64_t n = b->chunk[i];
        b->chunk[i] = total;
        total += n;
    }
    if (total > UINT32_MAX)
        return pvx_fail(d, PVX_ERANGE,
                        "camera %s: %llu matrix entries are more than the 2^32-1 of one block; use "
                        "fewer voxels or a larger binning",
                        b->c->name, (unsigned long long)total);
    pvx_pool_run(pool, chunks, place_chunk, b);
    b->colptr[b->N] = (uint32_t)total;
    *nnz = total;
    return PVX_OK;
}

/* Count, sum, fill. */
static pvx_err trace_camera(struct build *b, pvx_pool *pool, struct rec_sysmat_block *out,
                            struct pvx_diag *d)
{
    pvx_pool_run(pool, b->bands, clear_band, b);
    pvx_pool_run(pool, b->bands, trace_band, b);
    if (atomic_load(&b->canceled))
        return PVX_ECANCELED;
    PVX_TRY(sum_up(b, pool, &out->nnz, d));
    uint64_t bytes[4];
    rec_sysmat_section_bytes(b->m, out, bytes);
    if (!fits(b, bytes[0] + bytes[1] + bytes[2] + bytes[3]))
        return no_memory(b, bytes[1] + bytes[2], d);
    out->row = b->row = allocate(bytes[1]);
    out->val = b->val = allocate(bytes[2]);
    if (b->row == NULL || b->val == NULL)
        return no_memory(b, bytes[1] + bytes[2], d);
    pvx_pool_run(pool, b->bands, trace_band, b);
    return atomic_load(&b->canceled) ? PVX_ECANCELED : PVX_OK;
}

static pvx_err build_camera(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    struct rec_sysmat_block *out = &b->m->block[b->camera];
    b->bw = out->bw = b->c->width / b->binning;
    b->bh = out->bh = b->c->height / b->binning;
    b->bands = b->max_bands < (size_t)b->bh ? b->max_bands : (size_t)b->bh;
    atomic_store(&b->rows_done, 0);
    b->row = NULL;
    b->val = NULL;
    out->colptr = b->colptr = allocate((b->N + 1) * sizeof *b->colptr);
    struct rec_rect *fp = allocate(b->N * sizeof *fp);
    out->fp = fp;
    if (b->colptr == NULL || fp == NULL)
        return no_memory(b, b->N * (sizeof *fp + sizeof *b->colptr), d);
    size_t rays = (size_t)b->bw * (size_t)b->bh * (size_t)(b->rays * b->rays);
    b->ray = rays <= RAYS_MAX / sizeof *b->ray ? allocate(rays * sizeof *b->ray) : NULL;
    pvx_err e = trace_camera(b, pool, out, d);
    PVX_FREE(b->ray);
    PVX_TRY(e);
    b->m->nnz += out->nnz;
    if (rec_sysmat_footprints(b->m, b->c, out, pool, fp) != PVX_OK)
        return no_memory(b, 0, d);
    return PVX_OK;
}

static bool new_scratch(struct build *b)
{
    size_t max = rec_traverse_max(&b->m->grid);
    b->scratch = pvx_calloc(b->n_scratch, sizeof *b->scratch);
    if (b->scratch == NULL)
        return false;
    size_t merged = max * (size_t)(b->rays * b->rays);
    for (b->slot_bits = 4; (size_t)1 << b->slot_bits < 2 * merged;)
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
        s->order = pvx_calloc(merged, sizeof *s->order);
        if (s->slot == NULL || s->order == NULL)
            return false;
    }
    return true;
}

static void free_scratch(struct build *b)
{
    for (size_t i = 0; b->scratch != NULL && i < b->n_scratch; i++) {
        free(b->scratch[i].index);
        free(b->scratch[i].value);
        free(b->scratch[i].slot);
        free(b->scratch[i].order);
    }
    free(b->scratch);
}

static pvx_err build_all(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    /* several bands per thread even out that rays in the middle of an image are longer */
    size_t most = COUNTS_MAX / (b->N * sizeof *b->at);
    b->max_bands = pvx_pool_threads(pool) == 1 ? 1 : 4 * b->n_scratch;
    if (b->max_bands > most)
        b->max_bands = most > b->n_scratch ? most : b->n_scratch;
    b->c = &b->rig->cameras[0];
    b->at = allocate(b->max_bands * b->N * sizeof *b->at);
    b->chunk = pvx_calloc((b->N + CHUNK - 1) / CHUNK, sizeof *b->chunk);
    if (b->at == NULL || b->chunk == NULL || !new_scratch(b))
        return no_memory(b, b->max_bands * b->N * sizeof *b->at, d);
    for (b->camera = 0; b->camera < b->rig->n_cameras; b->camera++) {
        b->c = &b->rig->cameras[b->camera];
        PVX_TRY(build_camera(b, pool, d));
    }
    if (b->progress != NULL && !b->progress(b->ctx, 1))
        return PVX_ECANCELED;
    return PVX_OK;
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
    b.m->binning = b.binning = r.binning;
    b.m->rays_per_bin = b.rays = r.rays_per_bin;
    if (e == PVX_OK)
        e = build_all(&b, pool, d);
    free(b.at);
    free(b.chunk);
    free_scratch(&b);
    if (e == PVX_ECANCELED)
        pvx_fail(d, e, "stopped while building the system matrix");
    if (e != PVX_OK) {
        rec_sysmat_free(&b.m);
        return e;
    }
    *out = b.m;
    return PVX_OK;
}
