/* start.h - the initial x: zero or an earlier volume (levels.h: the solution on coarser grids).
 *
 * An earlier volume may fit worse than zero, and such a volume must not be the result at a deadline.  So each
 * lane is multiplied by the factor of the best fit,
 *     alpha = max(0, (A x)'W b / (A x)'W (A x))                                              (1)
 * Then the residual never exceeds ||b||, and an old flame of another brightness costs no iterations.
 * Call one of these or rec_levels_start after rec_problem_load, then rec_solve; x [n][cs].
 * Threads: as for the problem.  Nothing is allocated. */
#ifndef REC_START_H
#define REC_START_H
#include "recon/solve/problem.h"

/* x = 0. */
void rec_start_zero(rec_problem *pb, float *x);
/* From x >= 0, scaled by (1); from 0 where x is 0 or there is nothing to solve. */
void rec_start_earlier(rec_problem *pb, float *x);
/* The same for any x. */
void rec_start_scaled(rec_problem *pb, float *x);

#endif
