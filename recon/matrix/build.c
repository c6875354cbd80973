/* Building S, one camera after the other:
 *   trace    bands of rows of the image (rays.h)
 *   columns  all entries sorted into columns (columns.h)
 * then the cameras' columns are merged and the coarser levels added.
 * The result does not depend on how many bands or threads there are. */
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/mem.h"
#include "recon/matrix/columns.h"
#include "recon/matrix/footprint.h"
#include "recon/matrix/rays.h"

/* Memory of one running task; there are as many as threads. */
struct scratch {
    atomic_flag in_use;
    struct rec_rays rays;
};

struct build {
    const struct rec_rig *rig;
    rec_sysmat *m;
    size_t N;
    struct rec_tracer t; /* of the camera in work */
    struct scratch *scratch;
    size_t n_scratch;
    struct rec_band_rows rows;
    struct rec_entries *part; /* [cameras] */
    size_t camera;            /* in work */
    int32_t bh;
    /* progress */
    pthread_t caller;
    rec_progress_fn progress;
    void *ctx;
    atomic_int rows_done;
    atomic_bool canceled, out_of_memory;
};

static struct scratch *build_get_scratch(struct build *b)
{
    for (size_t i = 0;; i = (i + 1) % b->n_scratch) /* never more tasks at a time than scratches */
        if (!atomic_flag_test_and_set(&b->scratch[i].in_use))
            return &b->scratch[i];
}

static void build_tell(struct build *b)
{
    if (b->progress == NULL || !pthread_equal(pthread_self(), b->caller))
        return;
    double cameras = (double)b->camera + 0.9 * atomic_load(&b->rows_done) / b->bh;
    if (!b->progress(b->ctx, 0.95 * cameras / (double)b->rig->n_cameras))
        atomic_store(&b->canceled, true);
}

static void build_trace_band(void *ctx, size_t task)
{
    struct build *b = ctx;
    struct scratch *s = build_get_scratch(b);
    struct rec_band *out = &b->rows.band[task];
    out->n = 0;
    for (int32_t y = out->row0; y < out[1].row0; y++) {
        if (atomic_load(&b->canceled) || atomic_load(&b->out_of_memory))
            break;
        for (int32_t x = 0; x < b->t.bw; x++) {
            if (!rec_band_grow(out, b->t.bin_max)) {
                atomic_store(&b->out_of_memory, true);
                break;
            }
            size_t n = rec_rays_bin(&b->t, &s->rays, x, y, out->col + out->n, out->val + out->n);
            b->rows.bin_n[(size_t)y * (size_t)b->t.bw + (size_t)x] = (uint32_t)n;
            out->n += n;
        }
        atomic_fetch_add(&b->rows_done, 1);
        build_tell(b);
    }
    atomic_flag_clear(&s->in_use);
}

static pvx_err build_no_memory(const struct build *b, uint64_t bytes, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_ENOMEM,
                    "out of memory: the system matrix needs %llu MiB more for camera %s (%zu of "
                    "%zu); use fewer voxels, a larger binning, fewer cameras, or the box basis",
                    (unsigned long long)(bytes >> 20), b->rig->cameras[b->camera].name,
                    b->camera + 1, b->rig->n_cameras);
}

/* Linux grants more memory than there is and kills a process that uses it.  So the limit is the installed memory. */
static bool build_fits(const struct build *b, uint64_t more)
{
    uint64_t have = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t used = rec_band_entries(&b->rows) * REC_ENTRY;
    for (size_t i = 0; i < b->camera; i++)
        used += b->N * (sizeof(struct rec_rect) + sizeof(uint32_t)) + b->part[i].nnz * REC_ENTRY;
    return used + more <= have;
}

static pvx_err build_trace_camera(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    pvx_pool_run(pool, b->rows.bands, build_trace_band, b);
    if (atomic_load(&b->canceled))
        return PVX_ECANCELED;
    uint64_t nnz = rec_band_entries(&b->rows);
    if (atomic_load(&b->out_of_memory) || !build_fits(b, nnz * REC_ENTRY))
        return build_no_memory(b, nnz * REC_ENTRY, d);
    if (nnz > UINT32_MAX)
        return pvx_fail(
            d, PVX_ERANGE,
            "camera %s: %llu matrix entries are more than the 2^32-1 of one matrix; use "
            "fewer voxels or a larger binning",
            b->rig->cameras[b->camera].name, (unsigned long long)nnz);
    if (rec_columns(&b->rows, b->N, pool, &b->part[b->camera]) != PVX_OK)
        return build_no_memory(b, nnz * REC_ENTRY, d);
    return PVX_OK;
}

static void cut_bands(struct build *b)
{
    /* Rays in the middle of an image are longer: many bands balance that. */
    size_t bands = b->n_scratch <= 1 ? 1 : 16 * b->n_scratch;
    bands = bands < REC_BANDS_MAX ? bands : REC_BANDS_MAX;
    bands = bands < (size_t)b->bh ? bands : (size_t)b->bh;
    b->rows.bands = bands;
    b->rows.bw = b->t.bw;
    for (size_t k = 0; k <= bands; k++)
        b->rows.band[k].row0 = (int32_t)((size_t)b->bh * k / bands);
}

static pvx_err matrix_build_camera(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    struct rec_sysmat_block *block = &b->m->block[b->camera];
    struct rec_entries *out = &b->part[b->camera];
    size_t rows = (size_t)block->bw * (size_t)block->bh;
    rec_tracer_camera(&b->t, b->camera, block->bw);
    b->bh = block->bh;
    cut_bands(b);
    atomic_store(&b->rows_done, 0);
    struct rec_rect *fp = rec_sysmat_array(rec_brick_places(&b->m->grid) * sizeof *fp);
    block->fp = fp;
    b->rows.bin_n = rec_sysmat_array(rows * sizeof *b->rows.bin_n);
    bool room = rec_rays_new_depth(b->rig, rows, &out->depth);
    b->t.depth = out->depth;
    pvx_err e = fp == NULL || b->rows.bin_n == NULL || !room
                    ? build_no_memory(b, b->N * (sizeof *fp + sizeof *out->colptr), d)
                    : build_trace_camera(b, pool, d);
    PVX_FREE(b->rows.bin_n);
    PVX_TRY(e);
    if (rec_sysmat_footprints(b->m, b->t.bundle.c, block, out, pool, fp) != PVX_OK)
        return build_no_memory(b, 0, d);
    PVX_FREE(out->depth);
    return PVX_OK;
}

static pvx_err new_scratch(struct build *b)
{
    b->scratch = pvx_calloc(b->n_scratch, sizeof *b->scratch);
    if (b->scratch == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < b->n_scratch; i++)
        PVX_TRY(rec_rays_new(&b->t, &b->scratch[i].rays));
    return PVX_OK;
}

/* Frees what only the tracing of cameras needs. */
static void build_free_scratch(struct build *b)
{
    for (size_t i = 0; b->scratch != NULL && i < b->n_scratch; i++)
        rec_rays_free(&b->scratch[i].rays);
    rec_band_rows_free(&b->rows);
    free(b->scratch);
}

static pvx_err build_cameras(struct build *b, pvx_pool *pool, struct pvx_diag *d)
{
    if (new_scratch(b) != PVX_OK)
        return build_no_memory(b, b->n_scratch * b->t.bin_max * sizeof(struct rec_ray_slot), d);
    for (; b->camera < b->rig->n_cameras; b->camera++)
        PVX_TRY(matrix_build_camera(b, pool, d));
    return PVX_OK;
}

/* Refuses bodies that leave no camera a ray in the volume. */
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
    b->part = pvx_calloc(m->n_cameras, sizeof *b->part);
    pvx_err e = b->part == NULL ? PVX_ENOMEM : build_cameras(b, pool, d);
    build_free_scratch(b);
    if (e == PVX_OK && b->rig->bodies.n > 0)
        e = all_hidden(b, d);
    struct rec_entries all = {0};
    PVX_THEN(e, rec_sysmat_merge(m, b->part, pool, &all, d));
    for (size_t c = 0; b->part != NULL && c < m->n_cameras; c++)
        rec_entries_free(&b->part[c]);
    free(b->part);
    PVX_THEN(e, rec_sysmat_add_levels(m, &all, pool, d));
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
    pvx_err e = rec_sysmat_finest_frame(rig, &r, b.m, d);
    rec_tracer_init(&b.t, rig, &r);
    PVX_THEN(e, build_all(&b, pool, d));
    if (e == PVX_ECANCELED)
        pvx_fail(d, e, "stopped while building the system matrix");
    if (e != PVX_OK) {
        rec_sysmat_free(&b.m);
        return e;
    }
    *out = b.m;
    return PVX_OK;
}
