/* known.h - the constants of `spectral:` from light of known temperature.
 *
 *     log K_q = mean over the observations of log v_q - log L_q(T),  L_q = integral of S_q g B dl  (1)
 *     C = s^2 / n + noise^2 / n + J J' sd_T^2 + 1 1' sd_g^2 + 1 sd_curve^2,   J = d log L / dT     (2)
 * v_q pixel value [1], or a voxel's emission [1/m]; g the source's emissivity, or what soot absorbs (soot.h); s the scatter of the
 * observations (on the diagonal, as noise and sd_curve are), noise each observation's own.  The thermometer's error sd_T
 * and the emissivity's are common to all observations and channels; the response's, sd_curve, is each channel's own.
 * Soot of unknown amount (a thermocouple in a flame) gives the constants but for one factor: it is set for 1 ppm.
 * Threads: pure.  Cost: an integral for each observation. */
#ifndef REC_KNOWN_H
#define REC_KNOWN_H
#include <stddef.h>

#include "base/err.h"
#include "recon/spectral/planck.h"
#include "recon/spectral/soot.h"

#define REC_KNOWN_T_LO    600.0
#define REC_KNOWN_T_HI    4000.0
#define REC_KNOWN_SCATTER 0.1 /* of log K between observations: more is refused */

struct rec_known {
    double kelvin, value[3], sd[3]; /* sd: noise of each value */
};
struct rec_known_source {
    const struct rec_known *k; /* [n] */
    size_t n;
    rec_planck_factor *g; /* its emissivity; NULL: 1 */
    const void *ctx;      /* of g */
};
struct rec_known_doubt {
    double kelvin_sd;     /* K, common to all */
    double emissivity_sd; /* relative, common to all */
    double curve_sd;      /* relative, of each channel */
};
/* Sets constant, covariance and absolute (true) of s.  *scatter: standard deviation of log K between observations, the
 * worst channel; 0 for one.  PVX_EINVAL: a value that is not above its noise, a temperature outside the limits, a doubt
 * that is none, observations that contradict each other. */
PVX_MUST_CHECK pvx_err rec_known_source(const struct rec_known_source *l,
                                        const struct rec_known_doubt *doubt, struct rec_spectral *s,
                                        double *scatter, struct pvx_diag *d);
/* The same from the emission of soot at one place, whose temperature a thermocouple says; absolute is false.  em and a of
 * `p` as they will be used. */
PVX_MUST_CHECK pvx_err rec_known_soot(const struct rec_known *k, const struct rec_soot_params *p,
                                      const struct rec_known_doubt *doubt, struct rec_spectral *s,
                                      struct pvx_diag *d);
#endif
