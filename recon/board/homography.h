/* homography.h - the projective map that fits pairs of points best.
 *
 *     u = (h0 x + h1 y + h2) / (h6 x + h7 y + h8),   v = (h3 x + h4 y + h5) / (...)
 *
 * Fitted with weights by the direct linear transform on normalised points (Hartley & Zisserman, Multiple View
 * Geometry, 4.1 and 4.4) with the last element fixed, which is safe since the points' centre is not at infinity.
 * Cost: O(n). */
#ifndef REC_HOMOGRAPHY_H
#define REC_HOMOGRAPHY_H
#include <stdbool.h>
#include <stddef.h>

struct rec_pair {
    double x, y, u, v, weight;
};

/* False: the points do not determine it. */
bool rec_homography_fit(const struct rec_pair *p, size_t n, double h[9]);
bool rec_homography_inverse(const double h[9], double out[9]);
void rec_homography_map(const double h[9], double x, double y, double uv[2]);
/* duv [4]: du/dx, du/dy, dv/dx, dv/dy at (x, y). */
void rec_homography_jacobian(const double h[9], double x, double y, double duv[4]);
#endif
