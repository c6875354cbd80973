/* flame.h - an analytic flame in motion, whose line integrals are known without S.
 *
 *     e(x,t) = sum_g A_g(t) exp(-1/2 (x-m_g(t))^T Q_g(t) (x-m_g(t))),  Q = diag(1/s^2)    (1)
 *     integral along o + s d, |d| = 1, all s:
 *         A sqrt(2 pi / a) exp(-1/2 (c - b^2/a)),  a = d'Qd, b = d'Q(o-m), c = (o-m)'Q(o-m)  (2)
 * Source of (2): completing the square; own derivation.  With E = (m-o)/s and D = d/s, element by element, c - b^2/a
 * = |E x D|^2 / |D|^2.  This form is computed, since it has no cancellation.
 * Three channels: reddish outside, yellow-white in the core.  Blobs rise and fade in and out, each a whole number of
 * times per rec_flame.period_s.  So the motion has no seam and can be rendered once and replayed without end.
 * Amplitudes are such that the brightest pixel of the standard rig is about 0.8 (measured on a fan of rays when the
 * flame is made).
 * The flame stays inside [-0.4,0.4]^2 x [0.02,0.95] (to 3 standard deviations) of a box that is [-0.5,0.5]^2 x [0,1]
 * before it is scaled to the grid's.
 * Truth on a grid: exact voxel MEAN (box; a product of error functions), or value at the centre (trilinear).
 * Threads: pure after init. */
#ifndef REC_FLAME_H
#define REC_FLAME_H
#include <stdint.h>
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"

#define REC_FLAME_MAX_BLOBS 64
struct rec_blob {
    double m[3], s[3], a[3];
}; /* centre m, sigma m, amplitude per channel 1/m */
struct rec_flame_pose {
    int n;
    struct rec_blob blob[REC_FLAME_MAX_BLOBS];
};

struct rec_flame {
    double period_s; /* default 2.0 */
    int n_blobs;     /* default 40, at most REC_FLAME_MAX_BLOBS */
    uint32_t seed;
    double lo[3], hi[3]; /* volume the flame is fitted into, m */
    double gain;         /* amplitude of all blobs, set by init for the brightness above */
};

/* Standard flame fitted to a grid's box. */
void rec_flame_init(struct rec_flame *f, const struct rec_grid *g, uint32_t seed);
/* Blobs at time t [s], any t; periodic. */
void rec_flame_at(const struct rec_flame *f, double t_s, struct rec_flame_pose *out);
/* Integral along a ray (dir of unit length); out[3]. */
void rec_flame_ray(const struct rec_flame_pose *p, const double o[3], const double d[3],
                   double out[3]);
/* Image [h][w][3] float of camera c, mean over sub x sub rays per pixel; blobs are cut at 5
 * sigma and left out when they lie behind the camera.  Agrees with (2) to 1e-4 of the brightest
 * pixel.  Renders only rows [y0,y1), so that callers can run bands in parallel.  The bits do not
 * depend on the bands if these start at multiples of REC_FLAME_BAND rows. */
#define REC_FLAME_BAND 32
void rec_flame_render(const struct rec_flame_pose *p, const struct rec_camera *c, int sub,
                      int32_t y0, int32_t y1, float *image);
/* Truth on a grid, [nz][ny][nx][3]; only slices [k0,k1); blobs are cut at 5 sigma. */
void rec_flame_voxels(const struct rec_flame_pose *p, const struct rec_grid *g, int32_t k0,
                      int32_t k1, float *dense);

#endif
