/* absorb.h - a flame that absorbs its own light, made linear before it is solved.
 *
 * Soot that glows also absorbs: kappa = c e, e the mean of the channels' emissions.  With E(s) = the integral of
 * e from the camera to s, and E the integral over the whole ray,
 *     I = integral of e(s) exp(-c E(s)) ds = (1 - exp(-c E)) / c                                   (1)
 * This does not depend on the order of the emission along the ray, only on its total.  So the model is linear
 * again in
 *     E = -log(1 - c I) / c,   dE/dI = 1/D,   D = 1 - c I = exp(-c E), the ray's transmission       (2)
 * and nothing has to be traced or iterated: S, the hull and every solver stay as they were.  Every channel is
 * darkened like the mean, by
 *     R = I / E,   b_l := b_l / R                                                                  (3)
 * which is exact if the flame has one colour along a ray.  The noise of E grows with 1/D, that of a channel's
 * share of E with 1/R:  w := w / [1/R^2 + (1/D^2 - 1/R^2) / n],  n channels in the mean                (4)
 * If noise or another c brings 1 - c I below REC_ABSORB_LEAST, (2) continues along its tangent there.
 * Source: (1) is Beer and Lambert's law with kappa proportional to e, integrated; own derivation of the
 * rest (NUMERICS.md).  The derivative of I with respect to e at any place of a ray is D, not the
 * transmission from there to the camera: emission is seen itself, but it also darkens the light from behind
 * it. */
#ifndef REC_ABSORB_H
#define REC_ABSORB_H
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define REC_ABSORB_LEAST 0.02

/* (2) and its inverse (1); c >= 0 in 1 over pixel value. */
double rec_absorb_emitted(double c, double seen);
double rec_absorb_seen(double c, double emitted);

/* One picture, changed in place.  `mean`: for bins that do not have all channels (Bayer pixels as they are), the
 * channels of each bin [n][4] as they would be seen there; NULL: those of b. */
struct rec_absorb_picture {
    double c;
    size_t n;           /* bins */
    int nch;            /* 1, or 3 with 4 floats a bin */
    const uint8_t *lit; /* [n] in unlit bins (0) only values above the noise are changed */
    const float *mean;  /* or NULL */
    float *b, *weight;  /* [n][1 or 4], [n] */
    float *weight4;     /* [n][4] or NULL */
    float *least;       /* [n] or NULL: another weight, for rows that are bounds */
};
/* Applies (3) and (4) to every bin.  Bins that are not finite or have no weight stay without weight; c 0 changes
 * nothing.
 * Threads: pure.  Cost: one logarithm per lit bin. */
void rec_absorb_apply(const struct rec_absorb_picture *p);

#ifdef __cplusplus
}
#endif
#endif
