/* condition.h - how well a frame's restricted system determines the flame: its singular values.
 *
 *     K = [ W^(1/2) A ; sqrt(lambda) L ],   K'K = A'WA + lambda L L                          (1)
 *     sigma_max = max ||K x||,  sigma_min = the min(rows, columns)-th singular value,  ||x|| = 1
 *
 * A restricted system (subsys.h), L the second differences of smooth.h; lambda 0 leaves A alone.  Method: Golub-Kahan-Lanczos bidiagonalisation K V = U B in double from a random
 * unit start on the shorter side, every vector orthogonalised against all before it, twice; the
 * singular values of B are those of the tridiagonal [0 B; B' 0], reordered, by implicit QL.
 * The squared first components of its eigenvectors are the weights of a Gauss rule for the spectrum,
 * whose mean over starts estimates how many singular values lie above a limit.
 * Sources: G. H. Golub, W. Kahan, SIAM J. Numer. Anal. B 2(2):205, 1965; C. C. Paige, M. A. Saunders,
 * ACM TOMS 8(1):43, 1982; G. H. Golub, J. H. Welsch, Math. Comp. 23:221, 1969; S. Ubaru, J. Chen,
 * Y. Saad, SIAM J. Matrix Anal. Appl. 38(4):1075, 2017 (the count).
 *
 * Limits: after k steps sigma_max is a lower and sigma_min an UPPER estimate.  The largest converges
 * in some ten steps, the smallest of an ill-posed system late: condition is then a lower estimate.
 * Both are exact, to 1e-14 sigma_max, where `exact` says so.  rank means something
 * once sigma_min has come below the limit that it counts from; then it has a spread of about
 * sqrt(min(rows, columns) / probes) / 2.
 * For tools and tests, not for the frame path: allocates 8 (rows + columns) steps bytes, runs on one
 * thread and costs 2 products and 8 (rows + columns) k operations in step k.
 * Depends on: subsys.h. */
#ifndef REC_CONDITION_H
#define REC_CONDITION_H
#include "recon/subsys.h"

struct rec_condition_params {
    int32_t steps;  /* per start; 0 = 150; never more than min(rows, columns) */
    int32_t probes; /* random starts; 0 = 1 */
    double lambda;  /* absolute weight as in rec_solve_report, >= 0 */
    double limit;   /* rank counts singular values > limit * sigma_max; 0 = 1e-3 */
};

struct rec_condition {
    int32_t rows, columns; /* of K */
    int32_t steps;         /* done, the most of all starts */
    bool exact;            /* some start found an invariant subspace: its values are K's */
    double sigma_max, sigma_min;
    double condition; /* sigma_max / sigma_min; INFINITY where sigma_min is 0 to rounding */
    double rank;      /* estimated number of singular values above the limit */
};

/* weight [row space] as in rec_solve, or NULL = 1.  An empty system gives zeros.
 * Errors: PVX_EINVAL (lambda or limit negative or not finite, steps or probes negative), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_condition(const struct rec_subsys *a, const float *weight,
                                     const struct rec_condition_params *p,
                                     struct rec_condition *out);

#endif
