/* spd.h - small dense systems: A x = b for symmetric positive definite A [n][n], by Cholesky.
 *
 * The lower half of A becomes its factor, and b the solution.  False: a pivot is less than 1e-12 of A's own diagonal,
 * or a value is not finite; A and b are then lost.
 * Threads: pure.  Cost: n^3 / 6. */
#ifndef REC_SPD_H
#define REC_SPD_H
#include <stdbool.h>

bool rec_spd_solve(double *A, double *b, int n);

#endif
