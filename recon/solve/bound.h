/* bound.h - rows that are lower bounds, "at least this": a pixel at full scale.
 *
 *     1/2 w min(0, a x - b)^2 = min over t >= b of  1/2 w (a x - t)^2                                (1)
 *
 * So a method that minimises a sum of squares keeps a target t in place of such a row's b, and raises it to a x
 * wherever that is above b.  This t minimises (1) for the current x, so f falls or stays.  Rows above their bounds
 * have no part in a step's curvature.  Where a step brings some of them below, f may rise; x then goes back along the
 * step, as after any clip.  f stays convex and its gradient continuous, so the minimiser is that of the one-sided
 * problem.
 * Source: majorisation (Ortega & Rheinboldt 1970, 8.3); own arrangement. */
#ifndef REC_BOUND_H
#define REC_BOUND_H
#include "recon/solve/problem.h"

/* Raises the targets t of r = A x - t to those of x.  pb's right-hand side, r, wr = W r and rwr = r'Wr per lane
 * follow.  Without such rows nothing is done.  Same bits for any number of threads. */
void rec_bound_raise(rec_problem *pb, float *r, float *wr, double rwr[4]);
/* Reduces qwq = q'Wq per lane to the rows that are not above their bounds. */
void rec_bound_curvature(rec_problem *pb, const float *q, double qwq[4]);

#endif
