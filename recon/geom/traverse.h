/* traverse.h - exact walk of one ray through the grid: the entries of one row of S.
 *
 * box: s_ni = length of ray n inside voxel i (paper (13)); sum over i = chord of the ray in the box.
 * trilinear: s_ni = integral of basis function i along the ray (paper 4.1.2, (22) with its
 * errata), exact per cell of the dual lattice of voxel centres (support reaches h/2 outside).
 * Method: slab clip, then the crossing parameters of the three plane families are each computed
 * from the plane's index (never accumulated), so the walk is watertight: consecutive segments
 * share their end exactly, and the lengths sum to the chord.  A ray lying in a face belongs to the
 * voxel on the face's upper side (max face: lower side), so it is counted once.
 * Threads: pure.  Allocates nothing.  Cost O(nx+ny+nz). */
#ifndef REC_TRAVERSE_H
#define REC_TRAVERSE_H
#include <stddef.h>
#include "recon/geom/grid.h"

/* Upper bound of the entries that one ray can give on this grid (buffer size). */
size_t rec_traverse_max(const struct rec_grid *g);

/* Entries of the half line origin + s*dir, s >= 0 (a camera may stand inside the volume).
 * dir [3] need not have unit length; lengths are in metres.  index/value [rec_traverse_max()] out.
 * Returns the number of entries (0: misses).  An index occurs once per ray; values > 0, finite. */
size_t rec_traverse(const struct rec_grid *g, const double origin[3], const double dir[3],
                    int32_t *index, float *value);

/* The same for the first `length` metres of the ray (>= 0, or infinite): for a ray that ends at a surface. */
size_t rec_traverse_until(const struct rec_grid *g, const double origin[3], const double dir[3],
                          double length, int32_t *index, float *value);

#endif
