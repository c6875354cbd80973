#include "recon/matrix/sysmat.h"

#include <math.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <xxhash.h>

#include "base/mem.h"
#include "recon/matrix/marks.h"
#include "recon/matrix/store.h"

/* Raise this when the same rig and parameters give other entries than before: old caches become stale. */
#define METHOD_VERSION 3u

#define COARSEST 16 /* voxels along the longest side of the coarsest level, at least */

const struct rec_sysmat_params rec_sysmat_defaults = {0, 0};

/* Smallest size in pixels of a voxel at the centre of the volume, over the cameras that have it in front of them; 0
 * if no camera has. */
static double voxel_px(const struct rec_rig *rig)
{
    const struct rec_grid *g = &rig->grid;
    double h = fmin(rec_grid_h(g, 0), fmin(rec_grid_h(g, 1), rec_grid_h(g, 2))), least = 0, X[3];
    for (int a = 0; a < 3; a++)
        X[a] = 0.5 * (g->min[a] + g->max[a]);
    for (size_t i = 0; i < rig->n_cameras; i++) {
        const struct rec_camera *c = &rig->cameras[i];
        double z = rec_camera_depth(c, X);
        double px = z > 0 ? fmin(c->fx, c->fy) * h / z : 0;
        if (px > 0 && (least == 0 || px < least))
            least = px;
    }
    return least;
}

static bool divides_all(const struct rec_rig *rig, int32_t b, size_t *offender)
{
    for (size_t i = 0; i < rig->n_cameras; i++)
        if (rig->cameras[i].width % b != 0 || rig->cameras[i].height % b != 0) {
            *offender = i;
            return false;
        }
    return true;
}

pvx_err rec_sysmat_resolve(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                           struct rec_sysmat_params *out, struct pvx_diag *d)
{
    int32_t b = p->binning, k = p->rays_per_bin;
    size_t bad = 0;
    if (rig->n_cameras < 1 || rig->n_cameras > REC_MAX_CAMERAS)
        return pvx_fail(d, PVX_EINVAL, "the rig has %zu cameras; 1 to %d are needed",
                        rig->n_cameras, REC_MAX_CAMERAS);
    if (b < 0 || b > 64)
        return pvx_fail(d, PVX_EINVAL, "binning %d is outside 1..64 (0 = auto)", b);
    if (k < 0 || k > 16)
        return pvx_fail(d, PVX_EINVAL, "%d rays per bin are outside 1..16 (0 = auto)", k);
    if (b == 0) {
        double largest = 1.1 * voxel_px(rig);
        for (b = 1; b < 64 && 2 * b <= largest && divides_all(rig, 2 * b, &bad);)
            b *= 2;
    } else if (!divides_all(rig, b, &bad)) {
        const struct rec_camera *c = &rig->cameras[bad];
        return pvx_fail(
            d, PVX_EINVAL,
            "binning %d does not divide the %d x %d image of camera %s; choose one that "
            "does, or auto",
            b, c->width, c->height, c->name);
    }
    if (k == 0)
        k = 2;
    *out = (struct rec_sysmat_params){b, k};
    return PVX_OK;
}

pvx_err rec_sysmat_key(const struct rec_rig *rig, const struct rec_sysmat_params *p, uint64_t *key,
                       struct pvx_diag *d)
{
    struct rec_sysmat_params r;
    PVX_TRY(rec_sysmat_resolve(rig, p, &r, d));
    uint64_t words[4] = {rec_rig_hash(rig), (uint64_t)r.binning, (uint64_t)r.rays_per_bin,
                         METHOD_VERSION};
    uint8_t le[32];
    for (int i = 0; i < 32; i++)
        le[i] = (uint8_t)(words[i / 8] >> (8 * (i % 8)));
    *key = XXH3_64bits(le, sizeof le);
    if (*key == 0) /* 0 means "any" to rec_sysmat_load */
        *key = 1;
    return PVX_OK;
}

pvx_err rec_sysmat_alloc(size_t n_cameras, rec_sysmat **out)
{
    rec_sysmat *m = pvx_calloc(1, sizeof *m);
    struct rec_sysmat_block *b = pvx_calloc(n_cameras, sizeof *b);
    struct rec_sysmat_store *s = pvx_calloc(1, sizeof *s);
    *out = NULL;
    if (m == NULL || b == NULL || s == NULL) {
        free(m);
        free(b);
        free(s);
        return PVX_ENOMEM;
    }
    m->n_cameras = n_cameras;
    m->block = b;
    m->priv = s;
    *out = m;
    return PVX_OK;
}

pvx_err rec_sysmat_number_rows(rec_sysmat *m, struct pvx_diag *d)
{
    uint64_t rows = 0;
    for (size_t c = 0; c < m->n_cameras; c++) {
        m->row0[c] = (size_t)rows;
        rows += (uint64_t)m->block[c].bw * (uint64_t)m->block[c].bh;
    }
    m->row0[m->n_cameras] = (size_t)rows;
    if (rows > INT32_MAX)
        return pvx_fail(d, PVX_ERANGE,
                        "%llu bins of all cameras are more than the 2^31-1 of one matrix; use a "
                        "larger binning or fewer cameras",
                        (unsigned long long)rows);
    return PVX_OK;
}

pvx_err rec_sysmat_finest_frame(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                                rec_sysmat *m, struct pvx_diag *d)
{
    PVX_TRY(rec_sysmat_key(rig, p, &m->key, d));
    m->grid = rig->grid;
    m->unit = rec_sysmat_unit(&rig->grid);
    m->binning = p->binning;
    m->rays_per_bin = p->rays_per_bin;
    for (size_t c = 0; c < m->n_cameras; c++) {
        m->block[c].bw = rig->cameras[c].width / p->binning;
        m->block[c].bh = rig->cameras[c].height / p->binning;
    }
    return rec_sysmat_number_rows(m, d);
}

size_t rec_sysmat_columns(const rec_sysmat *m)
{
    return m->active != NULL ? m->active->columns : rec_grid_count(&m->grid);
}

void *rec_sysmat_array(uint64_t bytes)
{
    if (bytes > SIZE_MAX / 2)
        return NULL;
    return aligned_alloc(PVX_ALIGN, ((size_t)bytes + PVX_ALIGN) & ~((size_t)PVX_ALIGN - 1));
}

void *rec_sysmat_sparse(size_t bytes)
{
    void *p = pvx_reserve(bytes);
    if (p != NULL)
        madvise(p, bytes, MADV_NOHUGEPAGE); /* a huge one would hold columns that are not kept */
    return p;
}

float rec_sysmat_unit(const struct rec_grid *g)
{
    double h[3] = {rec_grid_h(g, 0), rec_grid_h(g, 1), rec_grid_h(g, 2)};
    return (float)(sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]) / 254);
}

void rec_sysmat_coarse_grid(const struct rec_grid *fine, struct rec_grid *coarse)
{
    *coarse = *fine;
    for (int a = 0; a < 3; a++) {
        coarse->n[a] = (fine->n[a] + 1) / 2;
        if (fine->n[a] & 1) /* the last voxel is half outside */
            coarse->max[a] = fine->max[a] + rec_grid_h(fine, a);
    }
}

size_t rec_sysmat_levels(const struct rec_grid *g)
{
    int32_t side = g->n[0] > g->n[1] ? g->n[0] : g->n[1];
    size_t levels = 1;
    for (side = side > g->n[2] ? side : g->n[2]; (side + 1) / 2 >= COARSEST; side = (side + 1) / 2)
        levels++;
    return levels;
}

void rec_sysmat_let_go(const rec_sysmat *m)
{
    const struct rec_sysmat_store *s = m->priv;
    if (s->map != NULL)
        madvise(s->map, s->map_bytes, MADV_DONTNEED);
}

void rec_sysmat_free(rec_sysmat **pm)
{
    rec_sysmat *m = *pm;
    if (m == NULL)
        return;
    rec_sysmat_free(&m->coarse);
    struct rec_sysmat_store *s = m->priv;
    if (s->map != NULL) {
        munmap(s->map, s->map_bytes);
    } else if (s->sparse) {
        struct rec_sparse_bytes z = rec_sparse_bytes(m);
        pvx_unreserve(m->win.at, z.at);
        pvx_unreserve(m->win.w, z.w);
        free(m->win.more);
        for (size_t i = 0; i < m->n_cameras; i++)
            pvx_unreserve((void *)m->block[i].fp, z.fp);
    } else if (!s->borrowed) {
        free(m->win.at);
        free(m->win.w);
        free(m->win.more);
        for (size_t i = 0; i < m->n_cameras; i++)
            free((void *)m->block[i].fp);
    }
    rec_active_free(&m->active);
    free(s);
    free(m->block);
    PVX_FREE(*pm);
}
