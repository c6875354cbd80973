/* glass.h - rays through the windows of a camera: camera.h (8).  For camera.c and what makes rays.
 * Threads: pure. */
#ifndef REC_GLASS_H
#define REC_GLASS_H
#include <stdbool.h>
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"

/* Takes the line origin + s dir (dir of unit length), as it is before the windows, through all of them.  Its new origin
 * is where it leaves the last one.  False: it does not pass one. */
bool rec_glass_pass(const struct rec_camera *c, double origin[3], const double dir[3]);

/* P = X - S of (8): where the camera seems to see X.  False: X is not behind all windows. */
bool rec_glass_apparent(const struct rec_camera *c, const double X[3], double P[3]);

/* Solves Y + S(Y/|Y|) = W, W from the camera's centre, for what is left of the way once the shift by n windows w is
 * taken off; their places are not looked at.  False: there is no way through. */
bool rec_glass_solve(const struct rec_glass *w, int32_t n, const double W[3], double Y[3]);
/* B [3][3] = dY/dW there. */
bool rec_glass_inverse(const struct rec_glass *w, int32_t n, const double Y[3], double B[9]);

/* D [2][3], slopes by the camera axes of P, becomes those by the camera axes of X.  Not for a telecentric, whose S is
 * constant. */
bool rec_glass_slopes(const struct rec_camera *c, const double P[3], double D[6]);

/* Bound of |d^2(u,v)/dX^2| [px/m^2] by the glass alone, along any line in the box that is grown by half a voxel all
 * round.  Negative: not known, because some corner of the box is not seen.  Not for a telecentric, which has none. */
double rec_glass_bend(const struct rec_camera *c, const struct rec_grid *g);

#endif
