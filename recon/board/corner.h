/* corner.h - where exactly a corner of a known print lies in a picture.
 *
 * The print around the corner is known, markers too, so it is drawn as the camera should see it - mapped
 * by the local homography, integrated over pixels, blurred - and laid on the picture:
 *
 *     I(u) = a T_s(u - d) + b        unknown: shift d, blur s, contrast a, level b                  (1)
 *
 * by Gauss-Newton (Lucas & Kanade, IJCAI 1981; Baker & Matthews, IJCV 56(3), 2004).  What a saddle point
 * or cornerSubPix do not know, a marker's edge beside the corner, is part of T and pulls nowhere.
 * Covariance: residual variance times the inverse of the normal matrix of (1), the rows of d; what the
 * model misses is in the residuals and so in the covariance. */
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
    double blur;         /* px, of a Gaussian, beside what a pixel integrates; in: where to begin */
    double contrast;     /* a: paper minus ink; below 0 where the colours are swapped */
    double likeness;     /* correlation of (1) with the picture, 0..1 */
    double moved;        /* px from where h had it */
};

/* h: board to picture near (x, y), the corner on the board.  fine: to the end, not only near it.
 * False: outside the picture, not determined, or it does not come to rest. */
bool rec_corner_refine(const struct rec_field *f, const struct rec_print *p, const double h[9],
                       const double xy[2], bool fine, struct rec_corner_fit *out);
#endif
