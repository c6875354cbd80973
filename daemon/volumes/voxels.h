/* voxels.h - a volume's bricks as the list of voxels that the publisher takes.  Threads: one at a time. */
#ifndef VOL_VOXELS_H
#define VOL_VOXELS_H
#include "daemon/volumes/volumes.h"

typedef struct vol_voxels vol_voxels;
/* Address space for every voxel of the grid; memory is used for those with flame. */
PVX_MUST_CHECK pvx_err vol_voxels_new(const struct pvp_grid *g, vol_voxels **out);
/* The voxels that are not 0, borrowed until the next call.  v has the grid. */
void vol_voxels_of(vol_voxels *x, const struct vol_volume *v, struct pvp_voxels *out);
/* The same with the error bars of these voxels, which may be none: voxels of which either is not 0.  sd->n is 0 without
 * bars. */
void vol_voxels_bars(vol_voxels *x, const struct vol_volume *v, struct pvp_voxels *out,
                     struct pvp_voxels *sd);
void vol_voxels_free(vol_voxels **x);
#endif
