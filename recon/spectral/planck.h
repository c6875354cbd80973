/* planck.h - what a hot body radiates, and what a camera's channel makes of it.
 *
 *     B(l, T) = 2 h c^2 / l^5 / (exp(c2 / (l T)) - 1),   c2 = h c / k                              (1)
 *     I_q(T)  = integral of S_q(l) g(l) B(l, T) dl                                                 (2)
 * l wavelength [m], T temperature [K], B spectral radiance [W m^-2 sr^-1 m^-1], S_q response of channel q
 * [1], g any factor: a source's emissivity, or soot's absorption (soot.h).  I_q [W m^-2 sr^-1], times g's unit.
 * Constants: SI of 2019 (exact).  Source of (1): M. Planck, Ann. Phys. 309:553, 1901.
 * (2) is summed by Gauss and Legendre with 4 points a piece of at most 5 nm, S straight in each: to 1e-9 of I.
 * Nothing overflows for l >= 200 nm and T >= 200 K (c2 / (l T) <= 360).
 * Threads: pure.  Cost: about 4 exponentials a piece. */
#ifndef REC_PLANCK_H
#define REC_PLANCK_H
#include "recon/geom/spectral.h"

#define REC_PLANCK_H_JS 6.62607015e-34
#define REC_PLANCK_C    299792458.0
#define REC_PLANCK_K    1.380649e-23
#define REC_PLANCK_C2   (REC_PLANCK_H_JS * REC_PLANCK_C / REC_PLANCK_K) /* m K */

/* (1) */
double rec_planck(double metres, double kelvin);

/* g of (2) at a wavelength. */
typedef double rec_planck_factor(const void *ctx, double metres);
/* (2) of channel q, and its derivative by 1/T where slope is not NULL; g NULL: 1. */
double rec_planck_channel(const struct rec_spectral *s, int q, double kelvin, rec_planck_factor *g,
                          const void *ctx, double *slope);
#endif
