/* hull_bricks.h - the bricks where a set's hull may be, before there is a matrix.
 * Threads and ownership: as hull.h. */
#ifndef REC_HULL_BRICKS_H
#define REC_HULL_BRICKS_H
#include "recon/carve/hull.h"

/* Marks the bricks of 4^3 voxels where a set's hull may be, a superset of those where it is: brick[i] = 1, else 0.
 * The matrix that h was made with may be an outline (recon/matrix/active.h).  lit, present: as rec_hull_carve.
 * Returns the number of marked bricks. */
size_t rec_hull_bricks(rec_hull *h, const struct rec_hull_params *p, const uint8_t *const *lit,
                       const bool *present, pvx_pool *pool, uint8_t *brick);
/* The rectangle around the footprints of a brick's voxels in camera c; REC_RECT_UNKNOWN (active.h) where one of them is
 * not seen.  S is whole. */
struct rec_rect rec_hull_rect(const rec_sysmat *S, size_t c, size_t brick);
#endif
