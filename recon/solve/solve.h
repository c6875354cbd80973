/* solve.h - solvers for the restricted system behind one interface (paper 4.3, DESIGN 5).
 *
 *   "cgls-paper"  the paper's literal CGLS: clip a_k, recursions untouched; stop by L-curve corner.
 *                 The baseline.  Diverges for large k, as paper.md says; returns the chosen iterate.
 *   "pcg"         minimise 1/2 ||W^(1/2)(A x - b)||^2 + lambda/2 ||L x||^2 over x >= 0, L the
 *                 second differences of the active voxels: projected preconditioned CG; the
 *                 objective never rises.  The default.
 * For comparison, without the smoothness term, so that when they stop decides how good they are:
 *   "cgls"        the paper's iteration without clipping; the result is clipped once.
 *   "mlem"        maximum-likelihood expectation maximisation (Shepp & Vardi, IEEE TMI 1:113, 1982).
 *   "osem"        the same over subsets of the cameras (Hudson & Larkin, IEEE TMI 13:601, 1994).
 *   "sirt"        projected Landweber/Cimmino iteration (Gilbert, J. Theor. Biol. 36:105, 1972).
 *   "fista"       the same with momentum (Beck & Teboulle, SIAM J. Imaging Sci. 2:183, 2009).
 *   "mrnsd"       modified residual norm steepest descent (Nagy & Strakos, Proc. SPIE 4121, 2000).
 * stop.h says what the stops mean for them.
 * All return the best iterate so far with a report, at the deadline too.  x is finite and >= 0.
 * Channels are solved together but do not influence each other. */
#ifndef REC_SOLVE_H
#define REC_SOLVE_H
#include <stdint.h>
#include "recon/solve/problem.h"

/* The methods, the default first: name and function.  Whoever needs a list of them makes it from this one. */
#define REC_SOLVERS(M)                    \
    M("pcg", rec_solve_pcg)               \
    M("cgls-paper", rec_solve_cgls_paper) \
    M("cgls", rec_solve_cgls)             \
    M("mlem", rec_solve_mlem)             \
    M("osem", rec_solve_osem)             \
    M("sirt", rec_solve_sirt)             \
    M("fista", rec_solve_fista)           \
    M("mrnsd", rec_solve_mrnsd)

#define REC_RENEWALS 6 /* at most, of V and lambda in a solve */

enum rec_stop { REC_STOP_AUTO, REC_STOP_LCURVE, REC_STOP_DISCREPANCY, REC_STOP_ITERATIONS };
/* How a solve ended; the numbers are those of the wire (PROTOCOL.md), where 3 was never sent. */
enum rec_status { REC_CONVERGED = 0, REC_MAX_ITER = 1, REC_DEADLINE = 2, REC_EMPTY = 4 };
const char *rec_status_name(enum rec_status s); /* "converged" "max-iter" "deadline" "empty" */

/* Called after each iteration with the current iterate, for tests and benches. */
typedef void (*rec_trace_fn)(void *ctx, uint32_t iteration, const float *x, double objective,
                             double residual_norm);

struct rec_solve_params {
    const char *solver; /* NULL or "" = default */
    enum rec_stop stop;
    uint32_t iterations; /* upper bound; 0 = the solver's default */
    float lambda;    /* weight of the smoothness term over the mean diagonal of A'WA; < 0 = auto */
    float tolerance; /* REC_STOP_AUTO: stop when x moves by less than this share of ||x||, or the
                        objective falls by less than half of it */
    int64_t deadline_ns; /* mono clock; 0 = none: return the best iterate by then */
    rec_trace_fn trace;  /* or NULL */
    void *trace_ctx;
};
#define REC_SOLVE_DEFAULTS                                                                       \
    {                                                                                            \
        .solver = NULL, .stop = REC_STOP_AUTO, .iterations = 0, .lambda = -1, .tolerance = 6e-3f \
    }
extern const struct rec_solve_params rec_solve_defaults;

struct rec_solve_report {
    enum rec_status status;
    const char *solver;  /* static string */
    uint32_t iterations; /* done */
    uint32_t best;       /* iterate returned */
    double
        rel_residual; /* ||W^(1/2)(A x - b)|| / ||W^(1/2) b|| over A's rows, all channels; 0 for b = 0 */
    double residual_norm, solution_norm;
    double objective; /* of the returned iterate; 0 where the method has none */
    double lambda;    /* absolute weight used, mean of the channels, at the end */
    /* Iterations after which the objective changed; how many did that. */
    uint32_t renewed[REC_RENEWALS], renewals;
    double
        misfit2[4]; /* mean of w (A x - b)^2 over measured rows, per lane, where the method knows */
    int64_t time_ns;
};

/* Names of all solvers, NULL-terminated; the first is the default. */
const char *const *rec_solver_names(void);
bool rec_solver_is_default(const char *name); /* NULL and "" too */

/* x [n][cs]: in: as a function of start.h left it, out: the result.
 * Errors: PVX_EINVAL (unknown solver, no start), PVX_EUNSUP (weights per channel with another than the
 * default solver or one channel). */
PVX_MUST_CHECK pvx_err rec_solve(rec_problem *pb, const struct rec_solve_params *p, float *x,
                                 struct rec_solve_report *out);

#endif
