/* Building the kept part of S, one camera after the other:
 *   trace    bands of rows of the image (active_rows.c).  Of each row, and of the rows of coarser levels that it
 *            completes, the entries in kept columns are stored; then the row is forgotten
 *   columns  the stored entries, level by level (columns.h)
 *   footprints
 * then on each level the cameras' columns are merged and made windows.  A thread has two rows of bins of each level
 * at a time.  The result does not depend on how many bands or threads there are. */
#include "recon/matrix/build_active.h"
#include "recon/matrix/footprint.h"
#include "recon/matrix/marks.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/mem.h"

static struct rec_active_scratch *matrix_get_scratch(struct rec_active_build *b)
{
    for (size_t i = 0;; i = (i + 1) % b->n_scratch) /* never more tasks at a time than scratches */
        if (!atomic_flag_test_and_set(&b->scratch[i].in_use))
            return &b->scratch[i];
}

static void matrix_tell(struct rec_active_build *b)
{
    if (b->progress.call == NULL || !pthread_equal(pthread_self(), b->caller))
        return;
    double rows = (double)b->level[0].m->block[b->camera].bh / (double)(b->of > 0 ? b->of : 1);
    double done = atomic_load(&b->rows_done) / rows;
    double cameras = (double)b->camera + 0.9 * (done < 1 ? done : 1);
    if (!b->progress.call(b->progress.ctx, 0.95 * cameras / (double)b->rig->n_cameras))
        atomic_store(&b->canceled, true);
}

static void matrix_trace_band(void *ctx, size_t task)
{
    struct rec_active_build *b = ctx;
    struct rec_active_scratch *s = matrix_get_scratch(b);
    size_t band = b->of > 0 ? task * b->of + b->of / 2 : task;
    const struct rec_band *rows = &b->level[0].rows.band[band];
    for (size_t l = 0; l < b->levels; l++) {
        b->level[l].rows.band[band].n = 0;
        s->pair[l].all.n = s->pair[l].second = 0;
    }
    for (int32_t y = rows->row0; y < rows[1].row0; y++) {
        if (atomic_load(&b->canceled) || atomic_load(&b->out_of_memory))
            break;
        if (!rec_active_row(b, s, band, y))
            atomic_store(&b->out_of_memory, true);
        atomic_fetch_add(&b->rows_done, 1);
        matrix_tell(b);
    }
    atomic_flag_clear(&s->in_use);
}

/* ---- cameras ---- */

static pvx_err matrix_no_memory(const struct rec_active_build *b, uint64_t bytes,
                                struct pvx_diag *d)
{
    return pvx_fail(d, PVX_ENOMEM,
                    "out of memory: the active part of the system matrix needs %llu MiB more for "
                    "camera %s (%zu of %zu); use fewer voxels or a larger binning",
                    (unsigned long long)(bytes >> 20), b->rig->cameras[b->camera].name,
                    b->camera + 1, b->rig->n_cameras);
}

/* Bands consist of whole rows of the coarsest level. */
void rec_active_cut(struct rec_active_build *b)
{
    size_t tall = (size_t)rec_bins_down(b, b->levels - 1);
    size_t bands = b->of > 0 ? REC_BANDS_MAX : 16 * b->n_scratch;
    bands = bands < REC_BANDS_MAX ? bands : REC_BANDS_MAX;
    bands = bands < tall ? bands : tall;
    for (size_t l = 0; l < b->levels; l++) {
        struct rec_band_rows *r = &b->level[l].rows;
        r->bands = bands;
        r->bw = rec_bins_across(b, l);
        for (size_t k = 0; k <= bands; k++) {
            int32_t row = (int32_t)(tall * k / bands << (b->levels - 1 - l));
            r->band[k].row0 = row < rec_bins_down(b, l) ? row : rec_bins_down(b, l);
        }
    }
}

static bool new_rows(struct rec_active_build *b)
{
    for (size_t l = 0; l < b->levels; l++) {
        struct rec_band_rows *r = &b->level[l].rows;
        const struct rec_sysmat_block *block = &b->level[l].m->block[b->camera];
        r->bin_n = rec_sysmat_array((size_t)block->bw * (size_t)block->bh * sizeof *r->bin_n);
        if (r->bin_n == NULL)
            return false;
        for (size_t i = 0; i < b->n_scratch; i++) {
            struct rec_row_pair *p = &b->scratch[i].pair[l];
            free(p->end);
            p->end = pvx_calloc(2 * (size_t)block->bw, sizeof *p->end);
            if (p->end == NULL)
                return false;
        }
    }
    memset((void *)b->met, 0, (rec_grid_count(&b->level[0].m->grid) + 63) / 64 * sizeof *b->met);
    return true;
}

void rec_active_end(struct rec_active_build *b)
{
    PVX_FREE(b->level[0].part[b->camera].depth);
    for (size_t l = 0; l < b->levels; l++)
        PVX_FREE(b->level[l].rows.bin_n);
}

/* Linux grants more memory than there is and kills a process that uses it.  So the limit is the installed memory. */
static bool matrix_fits(const struct rec_active_build *b)
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

pvx_err rec_active_trace(struct rec_active_build *b, pvx_pool *pool)
{
    size_t bands = b->level[0].rows.bands;
    atomic_store(&b->rows_done, 0);
    pvx_pool_run(pool, b->of > 0 ? (bands - b->of / 2 + b->of - 1) / b->of : bands,
                 matrix_trace_band, b);
    return atomic_load(&b->canceled) ? PVX_ECANCELED : PVX_OK;
}

static pvx_err matrix_trace_camera(struct rec_active_build *b, pvx_pool *pool, struct pvx_diag *d)
{
    rec_active_cut(b);
    PVX_TRY(rec_active_trace(b, pool));
    uint64_t nnz = rec_band_entries(&b->level[0].rows);
    if (atomic_load(&b->out_of_memory) || !matrix_fits(b))
        return matrix_no_memory(b, nnz * REC_ENTRY, d);
    if (nnz > UINT32_MAX)
        return pvx_fail(
            d, PVX_ERANGE,
            "camera %s: %llu matrix entries of the active part are more than the 2^32-1 of "
            "one matrix; use fewer voxels or a larger binning",
            b->rig->cameras[b->camera].name, (unsigned long long)nnz);
    for (size_t l = 0; l < b->levels; l++) {
        struct rec_active_level *v = &b->level[l];
        if (rec_columns(&v->rows, rec_sysmat_columns(v->m), pool, &v->part[b->camera]) != PVX_OK)
            return matrix_no_memory(b, nnz * REC_ENTRY, d);
        rec_band_rows_free(&v->rows);
    }
    return PVX_OK;
}

pvx_err rec_active_begin(struct rec_active_build *b)
{
    const struct rec_sysmat_block *block = &b->level[0].m->block[b->camera];
    struct rec_entries *part = &b->level[0].part[b->camera];
    rec_tracer_camera(&b->t, b->camera, block->bw);
    bool room = rec_rays_new_depth(b->rig, (size_t)block->bw * (size_t)block->bh, &part->depth) &&
                new_rows(b);
    b->t.depth = part->depth;
    return room ? PVX_OK : PVX_ENOMEM;
}

static pvx_err build_active_build_camera(struct rec_active_build *b, pvx_pool *pool,
                                         struct pvx_diag *d)
{
    pvx_err e =
        rec_active_begin(b) == PVX_OK ? matrix_trace_camera(b, pool, d) : matrix_no_memory(b, 0, d);
    if (e == PVX_OK &&
        rec_sysmat_active_footprints(b->level[0].m, b->camera, b->t.bundle.c,
                                     &b->level[0].part[b->camera], b->met, pool) != PVX_OK)
        e = matrix_no_memory(b, 0, d);
    rec_active_end(b);
    return e;
}

/* ---- levels ---- */

static pvx_err new_footprints(rec_sysmat *m)
{
    struct rec_sysmat_store *s = m->priv;
    size_t bytes = rec_sparse_bytes(m).fp;
    s->sparse = m->active != NULL;
    for (size_t c = 0; c < m->n_cameras; c++) {
        m->block[c].fp = s->sparse ? rec_sysmat_sparse(bytes) : rec_sysmat_array(bytes);
        if (m->block[c].fp == NULL)
            return PVX_ENOMEM;
    }
    return PVX_OK;
}

/* The coarse row in which each row of voxels of a level lies. */
static pvx_err new_parents(struct rec_active_level *v, const struct rec_grid *coarse)
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

/* Adds a coarser level with the bricks that it keeps; the coarsest keeps all. */
static pvx_err add_level(struct rec_active_build *b, bool coarsest)
{
    struct rec_active_level *v = &b->level[b->levels - 1];
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

static pvx_err matrix_set_up(struct rec_active_build *b, rec_sysmat *finest)
{
    size_t levels = rec_sysmat_levels(&finest->grid);
    b->levels = 1;
    b->level[0].m = finest;
    if (levels == 1) /* the vote uses all of it */
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

/* Frees what only the tracing of cameras needs. */
static void matrix_free_scratch(struct rec_active_build *b)
{
    for (size_t i = 0; b->scratch != NULL && i < b->n_scratch; i++) {
        struct rec_active_scratch *s = &b->scratch[i];
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

/* Merges the cameras' columns of a level, and makes their windows. */
static pvx_err finish_level(struct rec_active_level *v, pvx_pool *pool, struct pvx_diag *d)
{
    struct rec_entries all;
    pvx_err e = rec_sysmat_merge(v->m, v->part, pool, &all, d);
    PVX_THEN(e, rec_sysmat_make_windows(v->m, &all, pool, d));
    rec_entries_free(&all);
    return e;
}

static pvx_err build_active_build(struct rec_active_build *b, pvx_pool *pool, struct pvx_diag *d)
{
    for (; b->camera < b->rig->n_cameras; b->camera++)
        PVX_TRY(build_active_build_camera(b, pool, d));
    matrix_free_scratch(b);
    for (size_t l = 0; l < b->levels; l++)
        PVX_TRY(finish_level(&b->level[l], pool, d));
    if (b->progress.call != NULL && !b->progress.call(b->progress.ctx, 1))
        return PVX_ECANCELED;
    return PVX_OK;
}

pvx_err rec_active_build_new(struct rec_active_build **out, const struct rec_rig *rig,
                             rec_sysmat *finest, size_t threads, struct rec_progress progress)
{
    struct rec_sysmat_params p = {finest->binning, finest->rays_per_bin};
    struct rec_active_build *b = *out = pvx_calloc(1, sizeof *b);
    PVX_NEED(b);
    b->rig = rig;
    b->caller = pthread_self();
    b->progress = progress;
    b->n_scratch = threads;
    rec_tracer_init(&b->t, rig, &p);
    return matrix_set_up(b, finest);
}
void rec_active_build_free(struct rec_active_build **bp)
{
    struct rec_active_build *b = *bp;
    if (b == NULL)
        return;
    matrix_free_scratch(b);
    for (size_t l = 0; l < b->levels; l++)
        for (size_t c = 0; c < b->rig->n_cameras; c++)
            rec_entries_free(&b->level[l].part[c]);
    PVX_FREE(*bp);
}
pvx_err rec_sysmat_build_active(const struct rec_rig *rig, rec_sysmat **outline, pvx_pool *pool,
                                struct rec_progress progress, rec_sysmat **out, struct pvx_diag *d)
{
    rec_sysmat *m = *outline;
    struct rec_active_build *b;
    *outline = *out = NULL;
    pvx_err e = rec_active_build_new(&b, rig, m, pvx_pool_threads(pool), progress);
    if (e != PVX_OK)
        pvx_fail(d, e, "out of memory for the active part of the system matrix");
    else
        e = build_active_build(b, pool, d);
    if (e == PVX_ECANCELED)
        pvx_fail(d, e, "stopped while building the system matrix");
    rec_active_build_free(&b);
    if (e != PVX_OK)
        rec_sysmat_free(&m);
    *out = m;
    return e;
}
