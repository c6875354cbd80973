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
 * Channels are solved together but do not influence each other.
 * Threads: one solve per workspace.  Allocates nothing after rec_solver_new. */
#ifndef REC_SOLVE_H
#define REC_SOLVE_H
#include <stdbool.h>
#include <stdint.h>
#include "recon/subsys.h"

enum rec_stop { REC_STOP_AUTO, REC_STOP_LCURVE, REC_STOP_DISCREPANCY, REC_STOP_ITERATIONS };
enum rec_status { REC_CONVERGED, REC_MAX_ITER, REC_DEADLINE, REC_STAGNATED, REC_EMPTY };
const char *rec_status_name(enum rec_status s); /* "converged" "max-iter" "deadline" ... */

struct rec_solve_params {
    const char *solver; /* NULL or "" = default */
    enum rec_stop stop;
    uint32_t iterations; /* upper bound; 0 = the solver's default */
    float lambda;    /* weight of the smoothness term over the mean diagonal of A'WA; < 0 = auto */
    float tolerance; /* REC_STOP_AUTO: stop when the objective falls by less than this share */
    int64_t deadline_ns;  /* mono clock; 0 = none: return the best iterate by then */
    const double *weight; /* [4] absolute weight of the smoothness term per lane, instead of lambda;
                             NULL = none given */
    bool prepared;        /* rec_solve_weight was called last, for the same system and `weight` */
    bool lanes; /* w is [rowspace][4]: a row measures some channels only, b is 0 in the others */
    bool good_start; /* x fits b already, as a coarser solution does: it is not scaled */
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
    double lambda;    /* absolute weight used */
    double
        misfit2[4]; /* mean of w (A x - b)^2 over measured rows, per lane, where the method knows */
    int64_t time_ns;
};

typedef struct rec_solver rec_solver; /* work areas for one solve at a time */

/* Names of all solvers, NULL-terminated; the first is the default. */
const char *const *rec_solver_names(void);
bool rec_solver_is_default(const char *name); /* NULL and "" too */

/* Work areas for systems of S with `nch` channels (1 or 3).  Errors: PVX_ENOMEM, PVX_EINVAL. */
PVX_MUST_CHECK pvx_err rec_solver_new(const rec_sysmat *S, int nch, rec_solver **out);
void rec_solver_free(rec_solver **s);

/* The automatic weight of the smoothness term for this system, absolute, per lane: what rec_solve
 * uses when it is given none.  For the same flame on a grid of voxels twice the size, from pictures
 * averaged 2x2, it is an eighth.  noise2: the variance of b about A x that
 * it was chosen for, per lane; 0 when it was given.  false: there is nothing to solve. */
bool rec_solve_weight(rec_solver *s, const struct rec_subsys *a, const float *b, const float *w,
                      double sigma, const struct rec_solve_params *p, double weight[4],
                      double noise2[4]);
/* Where a coarser solution misses b by more than that noise, the model is at fault, by calibration or by
 * what it leaves out, and the noise is at least what it misses: the weight rises with it. */
void rec_solve_weight_for_misfit(const double noise2[4], const double misfit2[4], double weight[4]);

/* ||W^(1/2)(A x - b)||^2 of a start for the system that rec_solve_weight saw last; scale: x is scaled
 * per lane to the least of it first. */
double rec_solve_fit(rec_solver *s, const struct rec_subsys *a, bool scale, float *x);

/* b [rowspace][cs], w [rowspace] or with p->lanes [rowspace][4] (0..1; 0 = row is left out; only for
 * "pcg" and three channels), sigma = noise of b (full-scale units;
 * 0 = none, < 0 = unknown).  x [n][cs]: in: start (zero, or a warm start >= 0), out: result.
 * trace: called after each iteration with the current iterate (for tests and benches), or NULL.
 * Errors: PVX_EINVAL (unknown solver), PVX_EUNSUP (lanes with another than pcg or one channel); non-finite input is the caller's bug (photo.h cleans it). */
typedef void (*rec_trace_fn)(void *ctx, uint32_t iteration, const float *x, double objective,
                             double residual_norm);
PVX_MUST_CHECK pvx_err rec_solve(rec_solver *s, const struct rec_subsys *a, const float *b,
                                 const float *w, double sigma, const struct rec_solve_params *p,
                                 float *x, rec_trace_fn trace, void *trace_ctx,
                                 struct rec_solve_report *out);

#endif
