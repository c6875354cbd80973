/* misfit.h - whether the light of a whole recording fits the response curves.
 *
 * Other curves than the cameras' give each voxel a misfit (soot.h, (4)) that its bar may hide.  All voxels
 * have it alike, so its mean tells.  Of one volume
 *     X = sum_i w_i x_i / W,   w_i = 1 / s_i^2,   W = sum_i w_i                                     (1)
 * x_i misfit of voxel i, s_i^2 its variance by the noise.  With the modes d_k of the error bars, a_i the derivative
 * of x_i by e, b_i that by log K, C the calibration's covariance,
 *     var X = sum_k (sum_i w_i a_i'd_ki / W)^2 + sum_i w_i^2 t_i^2 / W^2 + B'C B,   B = sum_i w_i b_i / W   (2)
 * t_i^2 is what the modes leave of s_i^2.  Without modes all errors count as one: (sum_i w_i s_i / W)^2 in place of the
 * first two.  Over volumes X and its deviation are means, weighted by W: errors of volumes may be the same.
 * X over its deviation is near normal where the curves are right.
 * Threads: pure. */
#ifndef REC_MISFIT_H
#define REC_MISFIT_H
#include <stddef.h>
#include <stdint.h>
#include "recon/spectral/soot.h"

/* X over its deviation: above this, the curves do not fit (NUMERICS.md, 22). */
#define REC_MISFIT_MOST 4.0
/* Share of the voxels with light that must be soot or not soot.  Thin flames have fewer, whose dim channels have lost
 * detail: that is another colour too. */
#define REC_MISFIT_SHARE 0.1

#define REC_MISFIT_MODES 256u

/* Sums of (1) and (2) over some voxels of one volume. */
struct rec_misfit_part {
    double weight, x, s, t2, b[3];
    double modes[REC_MISFIT_MODES];
};
/* Of all volumes so far: sums of W, of W X, of W times the deviation of X. */
struct rec_misfit {
    double weight, x, sd;
};
/* Modes of one voxel's emission: that of mode k and channel q is d[k * stride + q], over tau[q] if there is tau. */
struct rec_misfit_modes {
    uint32_t n;
    size_t stride;
    const float *d, *tau;
};
/* Adds a voxel whose emission has the covariance N.  Nothing is added unless it is OK or NOT. */
void rec_misfit_add(struct rec_misfit_part *p, const struct rec_soot_voxel *x, const double N[9],
                    const struct rec_misfit_modes *m);
/* Adds the volume of which part[] has the n parts; L L' = C. */
void rec_misfit_volume(const struct rec_misfit_part *part, uint32_t n, uint32_t n_modes,
                       const double L[9], struct rec_misfit *out);
/* The mean misfit and its deviation; NAN: nothing was judged. */
void rec_misfit_mean(const struct rec_misfit *m, double *x, double *sd);
/* L of the calibration: L L' = C + REC_SOOT_OWN^2 on the diagonal, lower triangle. */
void rec_misfit_calibration(const double C[9], double L[9]);
#endif
