/* solve.h - solvers for the restricted system behind one interface (paper 4.3; NUMERICS.md, 4).
 *
 *   "cgls-paper"  the paper's literal CGLS: clip a_k, recursions untouched; stop by L-curve corner.
 *                 The baseline.  Diverges for large k. Returns the chosen iterate.
 *   "pcg"         minimise 1/2 ||W^(1/2)(A x - b)||^2 + lambda/2 ||L x||^2 over x >= 0, L the
 *                 second differences of the active voxels: projected preconditioned CG; the
 *                 objective never rises.  The default.
 * For comparison, without the smoothness term, so that their quality depends on when they stop:
 *   "cgls"        the paper's iteration without clipping; the result is clipped once.
 *   "mlem"        maximum-likelihood expectation maximisation (Shepp & Vardi, IEEE TMI 1:113, 1982).
 *   "osem"        the same over subsets of the cameras (Hudson & Larkin, IEEE TMI 13:601, 1994).
 *   "sirt"        projected Landweber/Cimmino iteration (Gilbert, J. Theor. Biol. 36:105, 1972).
 *   "fista"       the same with momentum (Beck & Teboulle, SIAM J. Imaging Sci. 2:183, 2009).
 *   "mrnsd"       modified residual norm steepest descent (Nagy & Strakos, Proc. SPIE 4121, 2000).
 * stop.h defines the stops for them.
 * All return the best iterate so far with a report, at the deadline too.  x is finite and >= 0.
 * Channels are solved together but do not influence each other. */
#ifndef REC_SOLVE_H
#define REC_SOLVE_H
#include "recon/solve/params.h"
#include "recon/solve/problem.h"

/* The methods, the default first: name and function.  Every list of methods is made from this one. */
#define REC_SOLVERS(M)                    \
    M("pcg", rec_solve_pcg)               \
    M("cgls-paper", rec_solve_cgls_paper) \
    M("cgls", rec_solve_cgls)             \
    M("mlem", rec_solve_mlem)             \
    M("osem", rec_solve_osem)             \
    M("sirt", rec_solve_sirt)             \
    M("fista", rec_solve_fista)           \
    M("mrnsd", rec_solve_mrnsd)

/* x [n][cs]: in: set by a function of start.h, out: the result.  Errors: PVX_EINVAL (unknown solver, no start),
 * PVX_EUNSUP (weights per channel, but not the default solver, or only one channel; a system on a card, and another
 * solver, the L-curve's stop, a trace, bounds or a prediction). */
PVX_MUST_CHECK pvx_err rec_solve(rec_problem *pb, const struct rec_solve_params *p, float *x,
                                 struct rec_solve_report *out);

#endif
