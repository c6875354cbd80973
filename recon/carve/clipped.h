/* clipped.h - blacks that are clipped: what is missing of a dark's noise, and the light that this adds.
 *
 * A sample is light plus noise of standard deviation s.  A camera without a pedestal sends nothing below 0, so of
 * y ~ N(mu, s^2) it sends max(0, y).  With t = mu/s, phi and Phi of the normal distribution,
 *     E max(0, y)     = s h(t),      h(t)   = t Phi(t) + phi(t)                                        (1)
 *     var max(0, y)   = s^2 v(t),    v(t)   = (t^2 + 1) Phi(t) + t phi(t) - h(t)^2                     (2)
 * Without light h(0) = 0.399 s is left: light that was not there, in every dark bin.
 * A bin is the mean of n samples: mean s h(t), variance s^2 v(t) / n.  In the dark both are measured, m and d^2, so
 *     h(t) / sqrt v(t) = m / (d sqrt n)                                                               (3)
 * gives t (what pedestal is left there), and s = d sqrt(n / v(t)).  Unclipped pictures have bins below the clip level, or
 * a pedestal that keeps t above REC_CLIPPED_CLEAR.
 * The bias is then taken out of each bin of value b above the clip level.  Of n > 1 samples (1) is inverted, and
 * continued below the dark's level h(t) by a line,
 *     b' = s h^-1(b / s)                     b >= s h(t)
 *     b' = s t + k (b - s h(t))              b <  s h(t),   k = 1 + (1/Phi(t) - 1) sqrt n / (1 + sqrt n)   (4)
 * The slope at h(t) would be 1/Phi(t).  h^-1 is concave, which makes few samples too dark; k makes up for it in the
 * dark: of t = 0 the mean of b' there is within 0.01 s, and at worst -0.06, -0.03 and -0.02 s in all light, of 4, 9
 * and 16 samples.  One sample tells whether it was cut.  So only those at the clip level, a share z of the dark, change,
 *     b' = -(m - s t) / z                                                                             (5)
 * the mean of what was cut; at worst -0.05 s over all light (Tobin, Econometrica 26:24, 1958).  Both have the noise
 * of unclipped samples within 15 %, so weights stay.
 * What the dark does not tell is not corrected: a pedestal far below 0 (t < REC_CLIPPED_DEEP), a background picture or
 * a dark map (another clip level in each bin), and more than 3/4 of single samples at 0.  There sigma is at least
 *     q / sqrt(12 n),   q the step of the samples                                                     (6)
 * from the least value above 0: n times less than q where samples were averaged.  A flat field scales s from bin to
 * bin; the s of the dark parts is used for all.
 * The last two functions are for all, the others private to recon/carve. */
#ifndef REC_CLIPPED_H
#define REC_CLIPPED_H
#include "recon/carve/photo.h"

#define REC_CLIPPED_CLEAR  2.0    /* s: less than 1 of 40 samples is cut */
#define REC_CLIPPED_DEEP   (-0.4) /* s */
#define REC_CLIPPED_WANTED 3.0    /* s: less than 1 of 700 samples is cut */
#define REC_CLIPPED_KNOTS  512

/* Of one channel. */
struct rec_clipped {
    bool is;
    double level;     /* of b, at which samples are clipped */
    double sigma;     /* s of a sample */
    double t, slope;  /* (3), never below 0; k of (4) */
    double dark, cut; /* h(t) s; one sample: what (5) puts instead of `level`, relative to it */
    double share;     /* of the dark's samples that are cut; 0: none */
    double pedestal;  /* keeps the dark REC_CLIPPED_WANTED s above the level, in samples' units */
};

/* The value of b at which the samples of a channel are clipped. */
static inline float rec_clipped_level(const struct rec_photo_image *im, int channel)
{
    return (0 - im->params->black) * im->gain[channel];
}
/* h^-1 from h(0) to 4, for a work area. */
void rec_clipped_table(float inverse[REC_CLIPPED_KNOTS]);
/* Finds (3) of a channel and, where its blacks are clipped, replaces its sigma; after noise was measured. */
void rec_clipped_find(const struct rec_photo_image *im, int channel);
/* The value of a bin from which (4) makes b; of single samples, and where blacks are not clipped, b. */
float rec_clipped_before(const struct rec_clipped *k, float b);
/* (4) or (5) of the bins with weight of rows [y0, y1). */
void rec_clipped_mend(const struct rec_photo_image *im, int32_t y0, int32_t y1);

/* Of single samples without light, mean above the clip level and standard deviation: the share of their noise that is
 * cut, and the pedestal that the camera lacks; 0 for both where t of (3) is above REC_CLIPPED_CLEAR. */
double rec_clipped_share(double mean, double sd, double *pedestal);

/* Says that a camera's blacks are clipped, and what cures it, of `cut` and `pedestal` as in its stats; false: so little
 * of the noise is cut that it does not matter (less than 1/20), and nothing is written. */
#define REC_PHOTO_CUT_TEXT 256
bool rec_photo_say_cut(double cut, double pedestal, char out[REC_PHOTO_CUT_TEXT]);

#endif
