/* fit.h - the box that a flame really fills, from the silhouettes of a recording.
 *
 *     B = box around the union of H_t over the frame sets t, grown by a margin               (1)
 *
 * H_t is the visual hull of set t (hull.h) on a coarse grid over the rig's volume.  So B contains the flame
 * as surely as the hull does: a cell is dropped only if a camera sees all of it and sees it dark.
 * Silhouettes are pooled for it: a pooled bin is lit when any bin of it is.
 * With few views a hull is wide: two silhouettes also cross in places that no other camera can exclude.  So B
 * is kept for every number of views that may be requested (rec_fit_get).
 * Flame outside the rig's volume is not searched for; `touches` tells that there may be some.
 * Threads: one call per rec_fit at a time.  rec_fit_add allocates nothing. */
#ifndef REC_FIT_H
#define REC_FIT_H
#include <stdbool.h>
#include "base/err.h"
#include "base/pool.h"
#include "recon/carve/hull.h"
#include "recon/geom/rig.h"

struct rec_fit_params {
    int32_t cells;      /* along the longest side of the rig's volume, 4..256 */
    int32_t binning;    /* raw pixels per bin side of the silhouettes that will be added */
    uint32_t min_views; /* smallest number of views that will be requested */
};
#define REC_FIT_DEFAULTS                           \
    {                                              \
        .cells = 48, .binning = 1, .min_views = 2, \
    }

typedef struct rec_fit rec_fit;

/* Errors: PVX_EINVAL, PVX_ENOMEM and those of rec_sysmat_build. */
PVX_MUST_CHECK pvx_err rec_fit_new(const struct rec_rig *rig, const struct rec_fit_params *p,
                                   pvx_pool *pool, rec_fit **out, struct pvx_diag *d);
void rec_fit_free(rec_fit **f);

/* One frame set: lit[c] [height/binning][width/binning] 0/1 of camera c, as rec_photo_apply leaves
 * it; present[c] false: camera c is ignored.  Returns the cells of its hull. */
int32_t rec_fit_add(rec_fit *f, const uint8_t *const *lit, const bool *present);

struct rec_fit_box {
    double min[3], max[3]; /* m, inside the rig's volume */
    double cell;           /* m, longest side of a coarse cell: B may be too large by this */
    unsigned touches;   /* bit 2a: hull reaches the volume's min along axis a; bit 2a+1: its max */
    uint32_t sets, lit; /* sets added; sets with a hull */
};
/* (1) of the cells that at least `views` cameras see (min_views .. number of cameras; 0 = min_views).
 * margin [m] on every side, < 0 = one coarse cell.  PVX_ENOENT: no set had a hull; PVX_EINVAL. */
PVX_MUST_CHECK pvx_err rec_fit_get(const rec_fit *f, uint32_t views, double margin,
                                   struct rec_fit_box *out);

/* The grid to reconstruct on.  n = {0,0,0}: voxels of the rig's size, on the rig's lattice;
 * {N,0,0}: cubes, N along the longest side; else just n.  The box grows to whole voxels.
 * PVX_ERANGE: more than REC_GRID_MAX voxels along a side. */
PVX_MUST_CHECK pvx_err rec_fit_grid(const struct rec_grid *rig, const struct rec_fit_box *box,
                                    const int32_t n[3], struct rec_grid *out);

#endif
