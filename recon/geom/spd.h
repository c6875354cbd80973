/* spd.h - small dense systems: A x = b for symmetric positive definite A [n][n], by Cholesky.
 *
 * A's lower half becomes its factor, b the solution.  False where a pivot is less than 1e-12 of A's own diagonal or
 * something is not finite; both are lost then.
 * Threads: pure.  Cost: n^3 / 6. */
#ifndef REC_SPD_H
#define REC_SPD_H
#include <stdbool.h>

bool rec_spd_solve(double *A, double *b, int n);

#endif
