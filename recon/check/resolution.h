/* resolution.h - the finest detail that a rig's pictures can resolve at their noise.  It follows from the singular
 * values of the system restricted to a flame's hull, which are not computed one by one.
 *
 *     share(v) = v' N (N + mu I)^-1 v / v' v = sum_i c_i^2 s_i^2 / (s_i^2 + mu),   N = A'A              (1)
 *     mu = (sigma / e)^2;  s_i: singular values of A; c_i: v's share of each right singular vector
 * v: a cosine along one axis of the grid inside the hull.  (1) is the share of v that survives in the best linear
 * estimate of a field whose voxels each may be off by e, from pictures with noise sigma: 1 all, 0 nothing.  Waves of
 * a detail's size (half a wave) with a share above one half survive.
 * Method: some Lanczos steps with N, started at v, give a tridiagonal T.  Its Gauss rule gives (1) for every mu at
 * once:
 *     share = (T (T + mu I)^-1)_11
 * No orthogonalization is needed for it.
 * Source: G. H. Golub & G. Meurant, Matrices, Moments and Quadrature with Applications, Princeton, 2010, ch. 3, 6.
 * Cost: 2 x REC_RESOLUTION_STEPS products a wave.  Threads: one caller; parallel inside; same bits for any number. */
#ifndef REC_RESOLUTION_H
#define REC_RESOLUTION_H
#include "recon/matrix/subsys.h"

#define REC_RESOLUTION_STEPS 24
#define REC_RESOLUTION_WAVES 7 /* detail sizes, from one voxel on */

/* (1) of v [a->n] for each mu [n]; one channel.  Of v = 0: 0.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_resolution_share(const struct rec_subsys *a, struct rec_images *im,
                                            const float *v, const double *mu, size_t n,
                                            double *share);

struct rec_resolution {
    double voxel[3];                   /* m, of the grid */
    double size[REC_RESOLUTION_WAVES]; /* of details, voxels, ascending */
    double share[3][2]
                [REC_RESOLUTION_WAVES]; /* along each axis, at the noise and at a quarter of it */
    double least[3][2]; /* m; of the smallest detail that survives; INFINITY: none does */
};
/* noise: sigma / e, in metres.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_resolution_find(const struct rec_subsys *a, struct rec_images *im,
                                           double noise, struct rec_resolution *out);

#endif
