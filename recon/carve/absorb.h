/* absorb.h - a flame that absorbs its own light, made linear before it is solved.
 *
 * Soot that glows absorbs as well: kappa = c e, e the mean of the channels' emissions.  With E(s) = the
 * integral of e from the camera to s, of which there is E in all,
 *     I = integral of e(s) exp(-c E(s)) ds = (1 - exp(-c E)) / c                                   (1)
 * whatever lies where on the ray: its light says what burns there, not in which order.  So the model is
 * linear again in
 *     E = -log(1 - c I) / c,   dE/dI = 1/D,   D = 1 - c I = exp(-c E), the ray's transmission       (2)
 * and nothing has to be traced or iterated: S, the hull and every solver are what they were.  A channel is
 * darkened as the mean is, by
 *     R = I / E,   b_l := b_l / R                                                                  (3)
 * which is exact where the flame has one colour along a ray.  What noise does to E grows with 1/D, to a
 * channel's share of it with 1/R:  w := w / [1/R^2 + (1/D^2 - 1/R^2) / n],  n channels in the mean     (4)
 * Where noise or another c brings 1 - c I below REC_ABSORB_LEAST, (2) goes on along its tangent there.
 * Source: (1) is Beer and Lambert's law with kappa proportional to e, integrated; own derivation of the
 * rest (NUMERICS.md).  The derivative of I with respect to e at any place of a ray is D, not the
 * transmission from there to the camera: what is behind is made darker by what is in front, which is
 * seen itself. */
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

/* One picture, in place.  `mean`: of each bin [n][4], the channels as they would be seen there, where a bin
 * has not them all (Bayer pixels as they are); NULL: b's own. */
struct rec_absorb_picture {
    double c;
    size_t n;           /* bins */
    int nch;            /* 1, or 3 with 4 floats a bin */
    const uint8_t *lit; /* [n] where it is 0 only what is bright for noise is changed */
    const float *mean;  /* or NULL */
    float *b, *weight;  /* [n][1 or 4], [n] */
    float *weight4;     /* [n][4] or NULL */
    float *least;       /* [n] or NULL: another weight, of rows that are bounds */
};
/* (3) and (4) of every bin.  What is not finite or has no weight stays without; c 0 changes nothing.
 * Threads: pure.  Cost: a logarithm a lit bin. */
void rec_absorb_apply(const struct rec_absorb_picture *p);

#ifdef __cplusplus
}
#endif
#endif
