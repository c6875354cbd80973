/* soot.h - temperature and volume fraction of soot, from the emission of three channels in one voxel.
 *
 *     e_q = f K_q I_q(T),   I_q(T) = integral of S_q(l) kappa(l) B(l, T) dl                        (1)
 *     kappa(l) = 6 pi E(m) / l (l0 / l)^(a - 1),   l0 = 550 nm                                     (2)
 * e_q emission of channel q [pixel value / m], f volume fraction of soot [1], K_q the calibration's constant [pixel
 * value / (W m^-2 sr^-1)], S_q response, kappa absorption coefficient over f [1/m], B Planck's radiance (planck.h).
 * (2) is Rayleigh's limit: spheres far smaller than the wavelength.  a = 1: E(m) does not depend on the wavelength.
 * Source: P. B. Kuhn et al., Proc. Combust. Inst. 33:743, 2011; J. A. H. Dreyer et al., Appl. Opt. 58:2662, 2019.
 * E(m) = 0.26 belongs to m = 1.57 - 0.56 i: K. C. Smyth, C. R. Shaddix, Combust. Flame 107:314, 1996.
 *
 * T and f have the least
 *     chi^2 = (e - f g)' V^-1 (e - f g),  g_q = K_q I_q(T),  V = N + diag(f g) C diag(f g)         (3)
 * N covariance of e in the voxel, C covariance of log K (and REC_SOOT_OWN^2 on its diagonal).  Three values, two unknowns: one degree of freedom.
 * chi^2 above `reject` is no soot.  The bars are from (J' V^-1 J)^-1, J the derivatives of (1) by log f and 1/T: they
 * hold the calibration's share, which all voxels have in common, and not the doubt about E(m), a or the response's shape.
 * For sums over voxels it matters what errors have in common, so the derivatives are given: (J' V^-1 J)^-1 J' V^-1 by e,
 * and that times -f g by log K.
 * log K that are off, and a response that is another one, move e from what soot can be, along h = g x dg/du:
 *     misfit = h'(e - f g) / (h_1 f g_1)                                                           (4)
 * the share by which the second channel (green) has more light than soot that fits the others.  chi^2 is its square over
 * its variance, in one voxel.  Its mean over voxels tells a wrong curve that no voxel can tell.
 * log f is near normal, f is not: with the bar s of log f, that of f is f sinh(2 s) / 2, of which two hold 95 of 100.
 *
 * log I_q is kept at even steps of 1/T with its exact slope and is a cubic between (Hermite): off by less than
 * (h R)^4 / 2048 of I, h the step, R the spread of c2 / l over the response; for 380 to 780 nm that is 2e-6.
 * Its slope is between c2 / l_max and c2 / l_min, so that it stays monotone.
 * Threads: rec_soot_new makes it, and then it is only read.  Cost: 0.7 microseconds a voxel, little where it is dark. */
#ifndef REC_SOOT_H
#define REC_SOOT_H
#include "base/err.h"
#include "recon/spectral/planck.h"

#define REC_SOOT_T_LO   800.0  /* K */
#define REC_SOOT_T_HI   3200.0 /* K; soot burns off above some 2600 K */
#define REC_SOOT_EM     0.26
#define REC_SOOT_L0     550e-9
#define REC_SOOT_REJECT 10.83 /* chi^2 of one degree of freedom that noise exceeds once in 1000 */
#define REC_SOOT_LIGHT  5.0 /* the light of the three channels over its noise: less is too little */
#define REC_SOOT_DOUBT  0.10 /* bar of T over T: more is too little light */
#define REC_SOOT_OWN \
    1e-3 /* share of its light that each channel is doubted by itself: no camera is straighter */
#define REC_SOOT_APART 600.0 /* K: the channels' mean c2 / l must be so far apart */

enum rec_soot_state {
    REC_SOOT_DARK,    /* too little light: nothing is said */
    REC_SOOT_OK,      /* soot of T and f */
    REC_SOOT_NOT,     /* light, but not that of soot: chi^2 is above `reject` */
    REC_SOOT_OUTSIDE, /* the best T is at an end of the range: too hot or too cold to be soot */
    REC_N_SOOT_STATES
};
/* "dark", "soot", "not soot", "outside" */
extern const char *const rec_soot_state_name[REC_N_SOOT_STATES];

struct rec_soot_params {
    double em, a;  /* of (2) */
    double reject; /* chi^2 */
    double light;  /* REC_SOOT_LIGHT */
};
extern const struct rec_soot_params rec_soot_defaults;
/* (2): a factor for rec_planck_channel; ctx: struct rec_soot_params. */
double rec_soot_kappa(const void *ctx, double metres);

typedef struct rec_soot rec_soot;
/* PVX_EINVAL: em, a or the limits are out of range; the three channels see too much the same colour (their mean c2 / l is
 * not REC_SOOT_APART apart), so that no ratio of them says a temperature.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_soot_new(const struct rec_spectral *s, const struct rec_soot_params *p,
                                    rec_soot **out, struct pvx_diag *d);
void rec_soot_free(rec_soot **m);

/* Emission of soot with volume fraction 1 at T, by the table: g of (3).  T is cut to the range. */
void rec_soot_emission(const rec_soot *m, double kelvin, double g[3]);

struct rec_soot_voxel {
    enum rec_soot_state state;
    /* NAN unless REC_SOOT_OK.  f: NAN, too, where the calibration is not absolute */
    double kelvin, kelvin_sd, f, f_sd;
    double chi2; /* NAN where dark */
    /* Only of OK: derivatives by e and by log K [3]; those of f by 0 where it is not known. */
    double kelvin_by_e[3], kelvin_by_k[3], f_by_e[3], f_by_k[3];
    /* Of OK and NOT: (4), and its derivatives. */
    double misfit, misfit_by_e[3], misfit_by_k[3];
};
/* e [3]; N [9], positive definite.  Values that are not finite, and a covariance that is not one, are dark. */
struct rec_soot_voxel rec_soot_solve(const rec_soot *m, const double e[3], const double N[9]);
#endif
