/* start.h - where an iteration starts: zero, an earlier volume, or coarser grids' solution.
 *
 * An earlier volume may fit worse than nothing, and that must not come out at a deadline: each lane of it
 * is scaled to the best fit on its ray,
 *     alpha = max(0, (A x)'W b / (A x)'W (A x))                                              (1)
 * so that the residual never exceeds ||b|| and an old flame of another brightness costs no iterations.
 * After rec_problem_load one of these, then rec_solve; x [n][cs].
 * Threads: as for the problem.  Nothing is allocated. */
#ifndef REC_START_H
#define REC_START_H
#include "recon/solve/levels.h"

/* x = 0. */
void rec_start_zero(rec_problem *pb, float *x);
/* From x >= 0 as it is there, scaled by (1). */
void rec_start_earlier(rec_problem *pb, float *x);
/* From the solution on coarser grids (levels.h), whose misfit raises the weight of the smoothness term
 * (rec_problem_misfit); the problem has been weighed.  earlier: x holds an earlier volume and stays,
 * scaled, where it leaves the smaller residual: after a flame that jumped it does not; spare [n][cs] is
 * then a work area, else NULL.  true: the start is the earlier volume. */
bool rec_start_coarse(rec_problem *pb, struct rec_descent *d, float *x, float *spare);

#endif
