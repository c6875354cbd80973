/* lcurve.h - corner of the L-curve, found while the iteration runs (paper 4.3).
 *
 *     curve (log ||A x_k - b||, log ||x_k||), k = 1, 2, ...; the corner is the point of largest
 *     curvature, here that of the circle through three neighbouring points (Menger)          (1)
 * Source: P. C. Hansen, Rank-Deficient and Discrete Ill-Posed Problems, SIAM 1998, ch. 4.6, 7.5.
 * A corner is accepted only `beyond` points later, if the curve has not bent more since.
 * Points that repeat the one before or are not finite are skipped. */
#ifndef REC_LCURVE_H
#define REC_LCURVE_H
#include <stdbool.h>
#include <stdint.h>

struct rec_lcurve {
    double lr[3], lx[3]; /* last three points, logarithms */
    uint32_t k[3];       /* their iteration numbers */
    int n;
    double best;     /* largest curvature so far */
    uint32_t best_k; /* iteration of the corner, 0 = none yet */
};

/* Add the point of iteration k >= 1 (k rising).  true: the PREVIOUS point, c->k[1], is now the
 * sharpest corner so far. */
bool rec_lcurve_add(struct rec_lcurve *c, uint32_t k, double residual_norm, double solution_norm);
/* The corner is accepted: k is `beyond` iterations past it. */
bool rec_lcurve_done(const struct rec_lcurve *c, uint32_t k, uint32_t beyond);

#endif
