/* bundle.h - the rays of a square of pixels: of a pixel, or of a bin.
 *
 * In a sharp camera they pass the square in `rays` x `rays` even steps.  With blur.sigma the light of the square comes
 * from the square convolved with a Gaussian.  Each axis is cut into
 *     N = rays sqrt(1 + 12 sigma^2 / px^2)                                                              (1)
 * parts of equal probability, a ray in the middle of each, and the rays are scaled to the variance px^2/12 + sigma^2.
 * With an aperture every ray of the square becomes M rays through points of equal area of the aperture (H. Vogel, Math.
 * Biosciences 44:179, 1979), which meet where the camera is focused.  With a bundle from a file it becomes the rays of
 * that bundle (ray_table.h).  All rays of a bundle have the same weight.
 * Units: px, m.  Threads: after init only read. */
#ifndef REC_BUNDLE_H
#define REC_BUNDLE_H
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"

#define REC_BUNDLE_SIDE 64   /* rays along a side, at most */
#define REC_BUNDLE_LENS 256  /* points of an aperture, at most */
#define REC_BLUR_MAX    16.0 /* px: the largest sigma, and radius of a disc of confusion */

struct rec_bundle {
    const struct rec_camera *c;
    int32_t side, lens;         /* side^2 lens rays */
    double at[REC_BUNDLE_SIDE]; /* px from the square's edge */
    double reach;               /* px beyond the square, at most */
};

/* Radius [px] of the largest disc of confusion of a point of the volume; 0 without an aperture.  Of a bundle from a file
 * an estimate: the largest of some pixels. */
double rec_blur_disc(const struct rec_camera *c, const struct rec_grid *g);

/* For squares of px x px, for the volume g. */
void rec_bundle_init(struct rec_bundle *b, const struct rec_camera *c, double px, int32_t rays,
                     const struct rec_grid *g);
static inline int32_t rec_bundle_rays(const struct rec_bundle *b)
{
    return b->side * b->side * b->lens;
}

/* Ray i of the square whose upper left edge is at (u,v).  False: the lens sees nothing there. */
bool rec_bundle_ray(const struct rec_bundle *b, double u, double v, int32_t i, double origin[3],
                    double dir[3]);

#endif
