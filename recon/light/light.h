/* light.h - a camera's response to light, from pictures without light, of an even source, and of a flame.
 *
 * Pictures are means and variances over several pictures of one scene: [height][width][channels] floats, 1 = full
 * scale, NaN = an unusable pixel; channels 1 (grey, or a Bayer filter's pixels with its cell) or 3.
 * Threads: pure.  Errors: PVX_EINVAL (and those a function names).  The message names neither camera nor file,
 * which the caller knows. */
#ifndef REC_LIGHT_H
#define REC_LIGHT_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "recon/geom/rig.h"

struct rec_light_picture {
    int32_t width, height;
    int channels;
    const uint8_t *cell; /* of a Bayer filter, else NULL */
    uint32_t n;          /* number of pictures it was made from */
    const float *mean, *var;
    double saturated; /* share of samples that were saturated in any of them */
    double exposure;  /* s; NAN = not known */
    double flicker;   /* variance of the pictures' means / mean^2; 0 of dark ones */
};

/* Limits for darks. */
#define REC_DARK_MOST 0.25 /* of full scale, in the middle of its distribution */
#define REC_DARK_UNEVEN \
    0.02                 /* of full scale, between the darkest and brightest 8th of the picture */
#define REC_DARK_LEAST 4 /* pictures */

struct rec_dark {
    size_t hot, dead;   /* pixels that became NaN */
    double level, read; /* median; read noise of a picture, full scale = 1 */
    /* Of rec_photo_say_cut: noise below black, which makes `level` too high and `read` too low. */
    double cut, pedestal;
};
/* out = mean, with NaN where the mean or the variance is off the median by more than 8 scaled MADs of all pixels
 * (and by 0.004 of full scale, the resolution of 8-bit darks).  Refused: light in the darks, or fewer than
 * REC_DARK_LEAST pictures. */
PVX_MUST_CHECK pvx_err rec_light_dark(const struct rec_light_picture *p, float *out,
                                      struct rec_dark *r, struct pvx_diag *d);

/* Sensitivity of each pixel from m pictures of an even source at m places:
 *     log p_k = log F + q_k(x, y),   sum over k of q_k = 0                                           (1)
 * q_k has degree 2: the part of the source's shading that changes from place to place.  The part common to all places
 * counts as the lens's, so the source is to be turned from picture to picture.  F is the mean of log p_k - q_k over
 * the pictures in which the pixel is within 6 sigma of (1) (dust on the source is beyond), scaled to mean 1 over the
 * middle quarter, per channel.  It is NaN outside 0.4..2.5 of the median of its neighbourhood.
 * Refused: m < 2; a region (an 8th of the picture each way) that is saturated, or dark (below 0.02 or a 20th of
 * the brightest). */
struct rec_flat {
    size_t bad;
    double vignetting; /* smallest mean of F over a region */
    double residual;   /* rms of log p_k - (1) */
};
PVX_MUST_CHECK pvx_err rec_light_flat(const struct rec_light_picture *p, size_t m, float *out,
                                      struct rec_flat *r, struct pvx_diag *d);

/* Light r(s) of a sample s from m exposures of one scene, m >= 4, with values at s = 0, 1/(n-1) .. 1:
 *     min over r of  [ sum over pixels p, exposures k of w_k (r(s_pk) - a_p - b_p t_k)^2 + h |r''|^2 ]
 *                    / sum of w_k (r(s_pk) - c_p)^2                                                  (2)
 * r(0) = 0, w_k = 1 / (t_k + t_max / 10)^2.  h is very small: values that no sample covers follow their neighbours.
 * a_p, b_p, c_p are eliminated, so a pedestal does no harm.  r is scaled to r(1) = 1 only at the end: the condition
 * r(1) = 1 instead of the denominator would make r small.  Then r is made monotone (pool adjacent violators), which
 * noise may require.
 * Refused: fewer exposures; exposures all in one ratio q (r (1 + a sin(2 pi log_q r)) would fit as well); samples
 * that do not cover 10 to 90 % of the range; samples that fall while the exposure rises. */
#define REC_RESPONSE_KNOTS 33
struct rec_response {
    double value[REC_RESPONSE_KNOTS];
    double residual; /* rms of r - a - b t, full scale */
};
PVX_MUST_CHECK pvx_err rec_light_response(const struct rec_light_picture *p, size_t m,
                                          struct rec_response *out, struct pvx_diag *d);

/* Photon transfer (Janesick, SPIE PM170, 2007): variance from picture to picture, of m levels of light,
 *     variance = read^2 + gain * mean,                                                               (4)
 * with the mean above the dark.  Both are taken over regions (an 8th of the picture each way).  The line is fitted to
 * the regions of all levels at once, by Tukey's biweight of the misfit relative to the line.  The part that all
 * samples of a picture share, flicker of the lamp, mean^2 * flicker, is subtracted first.  One level may be darks;
 * without it read is extrapolated.
 * Refused: fewer than 2 pictures to a level; levels within 0.05 of full scale or a factor of 2; saturation;
 * flicker above REC_NOISE_FLICKER; variances that no line fits (light that moves, samples that are not linear);
 * noise below a step of the samples, most of which then do not vary at all. */
#define REC_NOISE_FLICKER 0.02 /* rms, relative */
struct rec_noise {
    double read, gain;
};
PVX_MUST_CHECK pvx_err rec_light_noise(const struct rec_light_picture *p, size_t m,
                                       struct rec_noise *out, struct pvx_diag *d);

/* Mean of each channel over the middle quarter; grey: all three the same. */
void rec_light_middle(const struct rec_light_picture *p, double out[3]);

/* Light that a flame emits in all directions, from one picture, up to a factor common to all cameras:
 *     F = D^2 / (fx fy) * sum over pixels of p cos^3(angle to the axis) / det J                        (3)
 * J: d(x',y')/d(x,y) of the lens (camera.h).  D: distance to the flame's middle `at`.  Exact for a thin flame, except for the square of (its size / D).
 * PVX_EINVAL: no flame; PVX_ERANGE: flame at the picture's border. */
PVX_MUST_CHECK pvx_err rec_light_flux(const struct rec_light_picture *p, const struct rec_camera *c,
                                      const double at[3], double out[3], struct pvx_diag *d);
/* Point nearest to the rays through the middles of brightness.  PVX_EINVAL: fewer than two cameras with light, or
 * all rays parallel. */
PVX_MUST_CHECK pvx_err rec_light_where(const struct rec_light_picture *const *p,
                                       const struct rec_camera *c, size_t n, double at[3],
                                       struct pvx_diag *d);

/* Gains whose product is 1: proportional to 1 / light[i]; an entry of 0 or below is left out (gain 1). */
void rec_light_gains(const double *light, size_t n, double *gain);

/* Whether consecutive pictures show the same: means of 8 x 8 regions, added up. */
struct rec_light_still {
    double n, sum[64], sum2[64];
};
/* Adds a picture [height][width][stride], of which the first `channels` values count; values that are not finite
 * are left out. */
void rec_light_still_add(struct rec_light_still *s, const float *v, const int32_t size[2],
                         int channels, int stride);
/* The region that changed most, if the standard deviation of its mean over the pictures is above 0.002 + 2 % of
 * the mean: this is the flicker of a flame, more than the noise of a sensor or of lamps.  -1: none.  *by: that
 * deviation. */
int rec_light_moves(const struct rec_light_still *s, double *by);

/* The matrix M with the least sum over m patches of |M from_k - to_k|^2 / |from_k|^2; [m][3] each; *residual: its
 * rms.
 * Refused: m < 3; colours so alike that M would have more than 30 times the errors of the patches. */
PVX_MUST_CHECK pvx_err rec_light_matrix(const double *from, const double *to, size_t m,
                                        double matrix[9], double *residual, struct pvx_diag *d);
#endif
