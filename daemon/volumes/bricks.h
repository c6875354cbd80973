/* bricks.h - conversion between bricks and dense volumes [z][y][x][c].
 * Threads: pure; a store belongs to one thread. */
#ifndef VOL_BRICKS_H
#define VOL_BRICKS_H
#include "daemon/volumes/volumes.h"

/* Room for bricks, grown to the most that was asked for.  {0} is empty. */
struct vol_store {
    uint32_t *ids;
    float *brick;
    uint32_t room, n, channels;
};
PVX_MUST_CHECK pvx_err vol_store_grow(struct vol_store *s, uint32_t bricks, uint32_t channels);
void vol_store_free(struct vol_store *s);

/* Writes the volume's bricks into dense, which has to be zeroed before. */
void vol_to_dense(const struct vol_volume *v, float *dense);
/* Puts the bricks of a dense volume that are not all 0 into s.  PVX_ECORRUPT: a value is not finite; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err vol_from_dense(struct vol_store *s, const struct pvp_grid *g,
                                      const float *dense);
/* The same with a second volume, of which bars has the bricks: s and bars have those in which either is not 0. */
PVX_MUST_CHECK pvx_err vol_from_dense_bars(struct vol_store *s, struct vol_store *bars,
                                           const struct pvp_grid *g, const float *dense,
                                           const float *sd);
/* The same for a list of the voxels that are not 0. */
PVX_MUST_CHECK pvx_err vol_from_voxels(struct vol_store *s, const struct pvp_grid *g,
                                       const struct pvp_voxels *x);
#endif
