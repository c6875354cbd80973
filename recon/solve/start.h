/* start.h - where an iteration starts: at zero or at an earlier volume; levels.h: at the solution on coarser grids.
 *
 * An earlier volume may fit worse than nothing, and that must not come out at a deadline: each lane of it
 * is scaled to the best fit on its ray,
 *     alpha = max(0, (A x)'W b / (A x)'W (A x))                                              (1)
 * so that the residual never exceeds ||b|| and an old flame of another brightness costs no iterations.
 * After rec_problem_load one of these or rec_levels_start, then rec_solve; x [n][cs].
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
