#include <stdlib.h>

#include "base/mem.h"
#include "recon/matrix/active.h"
#include "recon/matrix/entries.h"
#include "recon/matrix/footprint.h"
#include "recon/matrix/marks.h"
#include "recon/matrix/rays.h"

static pvx_err outline_camera(rec_sysmat *m, const struct rec_rig *rig,
                              const struct rec_sysmat_params *p, size_t c, pvx_pool *pool)
{
    struct rec_sysmat_block *b = &m->block[c];
    struct rec_tracer t;
    rec_tracer_init(&t, rig, p);
    rec_tracer_camera(&t, c, b->bw);
    m->active->rect[c] = pvx_calloc(m->active->bricks, sizeof **m->active->rect);
    if (m->active->rect[c] == NULL ||
        !rec_rays_new_depth(rig, (size_t)b->bw * (size_t)b->bh, &t.depth))
        return PVX_ENOMEM;
    rec_rays_depth(&t, b->bh, pool);
    pvx_err e = rec_sysmat_brick_footprints(m, t.bundle.c, b, t.depth, pool, m->active->rect[c]);
    free(t.depth);
    return e;
}

pvx_err rec_sysmat_outline(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                           pvx_pool *pool, struct rec_progress progress, rec_sysmat **out,
                           struct pvx_diag *d)
{
    struct rec_sysmat_params r;
    *out = NULL;
    PVX_TRY(rec_sysmat_resolve(rig, p, &r, d));
    rec_sysmat *m;
    PVX_TRY(rec_sysmat_alloc(rig->n_cameras, &m));
    pvx_err e = rec_sysmat_finest_frame(rig, &r, m, d);
    if (e != PVX_OK) {
        rec_sysmat_free(&m);
        return e;
    }
    rec_sysmat_window_frame(m);
    e = rec_active_new(&m->grid, &m->active);
    for (size_t c = 0; c < m->n_cameras && e == PVX_OK; c++) {
        e = outline_camera(m, rig, &r, c, pool);
        if (e == PVX_OK && progress.call != NULL &&
            !progress.call(progress.ctx, (double)(c + 1) / (double)m->n_cameras))
            e = PVX_ECANCELED;
    }
    if (e != PVX_OK) {
        rec_sysmat_free(&m);
        if (e == PVX_ECANCELED)
            return pvx_fail(d, e, "stopped while bricks were looked for");
        return pvx_fail(d, e, "out of memory for the bricks of %d x %d x %d voxels", rig->grid.n[0],
                        rig->grid.n[1], rig->grid.n[2]);
    }
    *out = m;
    return PVX_OK;
}
