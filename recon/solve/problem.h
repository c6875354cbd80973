/* problem.h - the problem that a method solves: a restricted system with its right-hand side, and work areas.
 *
 *     minimise 1/2 ||W^(1/2) (A x - b)||^2 [+ lambda/2 ||L x||^2]  over x >= 0               (1)
 *
 * A frame goes through these steps in this order:
 *     rec_problem_load   b and W on A's rows, ||W^(1/2) b||, number of measured values
 *     rec_problem_weigh  diagonal of A'WA, lambda: only for the default method and coarser grids
 *     start.h            the initial x
 *     rec_solve          the method (solve.h)
 * Memory: for the worst case, every voxel active, in reserved address space; only touched pages cost memory.
 * Threads: one caller per problem.  Allocates nothing after rec_problem_new. */
#ifndef REC_PROBLEM_H
#define REC_PROBLEM_H
#include <stdbool.h>
#include "recon/matrix/subsys.h"

typedef struct rec_problem rec_problem;

/* Room for restrictions of S and of its coarser levels, with `nch` channels (1 or 3).
 * Errors: PVX_ENOMEM, PVX_EINVAL.  Owner: caller. */
PVX_MUST_CHECK pvx_err rec_problem_new(const rec_sysmat *S, int nch, rec_problem **out);
void rec_problem_free(rec_problem **pb);

/* Pictures in the row space of S; borrowed until the problem is solved. */
struct rec_pictures {
    const float *b;   /* [rowspace][cs] */
    const float *w;   /* [rowspace], or per_channel [rowspace][4]: 0..1, 0 = left out */
    bool per_channel; /* a row measures some channels only, b is 0 in the others: three channels */
    /* Per channel (grey: the same in all four): noise of b in the dark, full-scale units; 0 = none, < 0 = unknown.
     * Light adds to it: variance of b = sigma^2 + shot b; 0 = none or unknown. */
    double sigma[4], shot[4];
    /* Rows that are lower bounds (bound.h) in the channels of these bits, with this weight > 0, whatever w is.  NULL,
     * NULL: none.  Only the default solver uses them. */
    const float *least;      /* [rowspace] */
    const uint8_t *least_of; /* [rowspace] */
};

/* Non-finite pictures are a fault of the caller (photo.h cleans them).  false: all is dark, so there is nothing to
 * solve; rec_solve then reports that. */
bool rec_problem_load(rec_problem *pb, const struct rec_subsys *a, const struct rec_pictures *in);

/* The weight of the smoothness term, once per load: lambda of rec_solve_params. */
void rec_problem_weigh(rec_problem *pb, float lambda);
/* The weight of another grid's problem, divided by `by`.  For the same flame on voxels twice the size, from pictures
 * averaged 2x2, it is an eighth. */
void rec_problem_weigh_as(rec_problem *pb, const rec_problem *other, double by);
/* Raises the weight if a coarser solution misses b by more than the noise for which the weight was chosen.  The cause
 * may then be the model: calibration, or effects that it leaves out; the noise is at least what the solution misses.
 * The solve begins with a weight that is higher by that factor, and keeps it if the fault is on the fine grid too
 * (lambda.c).  misfit2 [4] as in rec_solve_report. */
void rec_problem_misfit(rec_problem *pb, const double misfit2[4]);

#endif
