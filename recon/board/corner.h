/* corner.h - the exact place of a corner of a known print in a picture.
 *
 * The print around the corner is known, including markers.  So it is drawn as the camera should see it - mapped by
 * the local homography, integrated over pixels, blurred - and fitted to the picture:
 *
 *     I(u) = a T_s(u - d) + b        unknown: shift d, blur s, contrast a, level b                  (1)
 *
 * by Gauss-Newton (Lucas & Kanade, IJCAI 1981; Baker & Matthews, IJCV 56(3), 2004).  A marker's edge beside the
 * corner is part of T, so it causes no error, unlike with a saddle point or cornerSubPix.
 * Covariance: residual variance times the inverse of the normal matrix of (1), the rows of d.  Errors of the model
 * are in the residuals and therefore in the covariance. */
#ifndef REC_CORNER_H
#define REC_CORNER_H
#include <stdint.h>
#include "recon/board/print.h"

struct rec_field {
    const float *level; /* [height][width], 1 = full scale */
    int32_t width, height;
};

struct rec_corner_fit {
    double x, y, cov[3]; /* px; xx, xy, yy */
    double blur;     /* px, of a Gaussian, in addition to the pixel's integration; in: the start */
    double contrast; /* a: paper minus ink; below 0 where the colours are swapped */
    double likeness; /* correlation of (1) with the picture, 0..1 */
    double moved;    /* px from the place given by h */
};

/* h: board to picture near xy, the corner on the board.  fine: iterate to full precision, not
 * only close to it.  False: outside the picture, not determined, or not converged. */
bool rec_corner_refine(const struct rec_field *f, const struct rec_print *p, const double h[9],
                       const double xy[2], bool fine, struct rec_corner_fit *out);
#endif
