#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "recon/matrix/build_active.h"
#include "recon/matrix/marks.h"

#define PAGE 4096
/* At least so many bands of rows are traced, because a flame may be in few of an image's rows. */
#define LEAST_BANDS 8
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
static uint64_t matrix_stored(const rec_sysmat *m, size_t window)
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

/* Memory at its peak: entries are first in a band, whose room grows by half, then in columns, then merged over the
 * cameras slice by slice, and still there while windows are made of them. */
static void matrix_add_up(const struct rec_active_build *b, double kept_most,
                          struct rec_active_estimate *o)
{
    double entries = o->kept * REC_ENTRY, windows = 0, columns = 0, first = 0;
    double rows = 2 * 1.34 * 1.5 * (double)atomic_load(&b->row_most) * REC_ENTRY;
    /* with at most so many entries per voxel and camera, 3x4 bins hold a voxel and the next one */
    o->window =
        o->entries <= 6.0 * (double)b->rig->n_cameras * (double)rec_grid_count(&b->rig->grid)
            ? 12
            : REC_WINDOW_MAX;
    for (size_t l = 0; l < b->levels; l++) {
        const rec_sysmat *m = b->level[l].m;
        o->stored += matrix_stored(m, o->window);
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

static pvx_err estimate(struct rec_active_build *b, double share, pvx_pool *pool,
                        struct rec_active_estimate *o)
{
    double kept_most = 0, all_traced = 0;
    for (; b->camera < b->rig->n_cameras; b->camera++) {
        const struct rec_sysmat_block *block = &b->level[0].m->block[b->camera];
        size_t bins = (size_t)block->bw * (size_t)block->bh, traced = 0;
        int64_t t0 = pvx_now_mono();
        pvx_err e = rec_active_begin(b);
        b->of = 1;
        rec_active_cut(b);
        double most = (double)(b->level[0].rows.bands / LEAST_BANDS);
        b->of = (size_t)fmax(fmin(1 / share, most), 1);
        uint64_t before = atomic_load(&b->entries);
        PVX_THEN(e, rec_active_trace(b, pool));
        rec_active_end(b);
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
        kept_most = fmax(kept, kept_most);
        o->kept += kept;
        all_traced += (double)traced;
        o->bins += bins;
        o->entries += by * (double)(atomic_load(&b->entries) - before);
        o->seconds += by * (double)(pvx_now_mono() - t0) * 1e-9;
    }
    /* A thin flame may lie between all traced bands.  So assume about as many entries in each column. */
    double least = o->entries * (double)rec_sysmat_columns(b->level[0].m) /
                   (double)rec_grid_count(&b->level[0].m->grid);
    o->kept = fmax(o->kept, least);
    o->share = all_traced / (double)o->bins;
    matrix_add_up(b, fmax(kept_most, least / (double)b->rig->n_cameras), o);
    return PVX_OK;
}

/* A temporary copy of the outline, with its marks. */
static pvx_err copy_outline(const struct rec_rig *rig, const rec_sysmat *outline, rec_sysmat **out,
                            struct pvx_diag *d)
{
    struct rec_sysmat_params p = {outline->binning, outline->rays_per_bin};
    PVX_TRY(rec_sysmat_alloc(rig->n_cameras, out));
    pvx_err e = rec_sysmat_finest_frame(rig, &p, *out, d);
    rec_sysmat_window_frame(*out);
    PVX_THEN(e, rec_active_new(&outline->grid, &(*out)->active));
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
    struct rec_active_build *b = NULL;
    *out = (struct rec_active_estimate){0};
    PVX_TRY(copy_outline(rig, outline, &m, d));
    pvx_err e = rec_active_build_new(&b, rig, m, pvx_pool_threads(pool), progress);
    if (e == PVX_OK) {
        e = estimate(b, share < 1 ? share : 1, pool, out);
        out->columns = m->active->columns;
    }
    rec_active_build_free(&b);
    rec_sysmat_free(&m);
    if (e == PVX_ENOMEM)
        pvx_fail(d, e, "out of memory while the system matrix is estimated");
    return e == PVX_ECANCELED ? pvx_fail(d, e, "stopped while the system matrix was estimated") : e;
}

double rec_sysmat_whole(const struct rec_rig *rig, const struct rec_sysmat_params *p)
{
    const struct rec_grid *g = &rig->grid;
    double at_most = 0, slots = (double)((rig->n_cameras + 3) / 4 * 4);
    for (size_t c = 0; c < rig->n_cameras; c++) { /* largest side of a voxel in bins */
        const struct rec_camera *k = &rig->cameras[c];
        double x[3], d2 = 0, h = 0;
        rec_camera_centre(k, x);
        for (int a = 0; a < 3; a++) {
            double d = x[a] - 0.5 * (g->min[a] + g->max[a]);
            d2 += d * d;
            h = fmax(h, rec_grid_h(g, a));
        }
        if (k->model >= REC_TELECENTRIC) {
            double X[3];
            for (int a = 0; a < 3; a++)
                X[a] = 0.5 * (g->min[a] + g->max[a]);
            d2 = rec_camera_depth(k, X);
            d2 *= d2;
        }
        struct rec_bundle b;
        rec_bundle_init(&b, k, p->binning, p->rays_per_bin, g);
        at_most = fmax(at_most, d2 > 0 ? fmax(k->fx, k->fy) * h / sqrt(d2) / p->binning +
                                             2 * b.reach / p->binning
                                       : 0);
    }
    double side = g->basis == REC_TRILINEAR ? 2 * at_most + 1 : at_most + 1;
    double entries = fmax(0.55 * side * side, 1), more = entries > 12 ? 28 * entries / 6 : 0;
    double voxels = (double)rec_grid_count(g) * 8 / 7, cameras = (double)rig->n_cameras;
    return voxels * (cameras * (5 * entries + sizeof(struct rec_rect) + more) + slots * 16);
}
