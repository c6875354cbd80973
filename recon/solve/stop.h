/* stop.h - when an iteration ends and which iterate is the result.  The methods without a smoothness
 * term are semi-convergent: the error falls, and rises again once they fit the noise.
 *
 *     REC_STOP_DISCREPANCY  the first iterate with  ||W^(1/2) (A x - b)||^2 <= sigma^2 m     (1)
 *     REC_STOP_AUTO         (1), or the first whose residual is within twice the noise and fell by
 *                           less than own.stall of ||..||^2 in an iteration: if the basis cannot
 *                           follow the flame, (1) may never be met.  A method may name another rule:
 *                           the L-curve, or the first iterate that lowered the objective by less
 *                           than own.gain of it
 *     REC_STOP_LCURVE       the corner of lcurve.h, accepted 6 iterations later; the iterate there
 *     REC_STOP_ITERATIONS   the last iterate
 * m counts measured values, sigma is their noise: (1) is the residual that the true x would leave.  Without
 * noise (sigma 0) (1) is not met, and the bound on the iterations ends the solve.  When sigma is unknown, the
 * bound is one that suits a noise of 1 %.  p.iterations, if given, replaces the bound.  The deadline always
 * holds.
 * Why: on smooth and ragged flames, both bases, 0 to 5 % noise, more or fewer rays than
 * voxels, AUTO ends within 10 % of the least error on the way for every method here (mlem and osem
 * at 5 %: 24 %). Where details are finer than the voxels it goes on too long, by up to 1.5 times
 * the least error, because the misfit of details that the basis cannot show does not look like noise.
 * The L-curve does worse everywhere: ||x|| hardly rises when x >= 0, so the curve has no upright arm.  Rays that
 * are held out to judge the fit do worse too: the cameras that are fitted see them too, and they ask for some
 * three times the iterations.
 * Source: V. A. Morozov, Soviet Math. Dokl. 7:414, 1966.  Private to recon/solve. */
#ifndef REC_STOP_H
#define REC_STOP_H
#include "recon/solve/impl.h"

/* The settings of a method. */
struct rec_stop_own {
    bool corner;    /* AUTO is the L-curve */
    uint32_t most;  /* bound on the iterations */
    uint32_t blind; /* the same when AUTO has to work without sigma */
    double stall;   /* share of the residual^2 by which an iteration has to lower it */
    /* Used under any rule; 0: not a rule of the method.  If gain is set, AUTO is these two alone.  gain: share by
     * which an iteration has to lower the objective.  still: share of ||x|| by which it has to move x, more after a
     * good start (stop.c). */
    double gain, still;
};

struct rec_stopper {
    rec_problem *pb;
    const struct rec_solve_params *p;
    struct rec_solve_report *out;
    uint32_t k, limit; /* iterations done; most */
    double noise2;     /* right side of (1), 0 = not the rule */
    double last;       /* residual^2 of the iterate before */
    double stall;      /* 0 = not the rule */
    double gain;       /* 0 = not the rule */
    double still;      /* the same of own.still */
    double moved;      /* in, for rec_stop_after: ||dx|| / ||x|| of the iteration */
    double first;      /* the same of the first iteration */
    uint32_t hold;     /* neither gain nor still counts before this iteration */
    double objective;  /* of the iterate before */
    bool corner;
    struct rec_lcurve curve;
    double best_objective, prev_objective; /* of pb->corner, pb->before */
};

/* For own.gain, out->objective must be that of the start. */
void rec_stop_begin(struct rec_stopper *t, rec_problem *pb, const struct rec_stop_own *own,
                    const struct rec_solve_params *p, struct rec_solve_report *out);
/* Whether another iteration follows; if not, the status of the report gives the reason. */
bool rec_stop_next(struct rec_stopper *t);
/* x is iterate number ++k, with this objective and ||W^(1/2) (A x - b)||^2, which go into the report and to the
 * trace.  True: it was the last. */
bool rec_stop_after(struct rec_stopper *t, const float *x, double objective, double residual2);
/* From here on the method minimises another objective, with this value now.  far: it differs so much that the first
 * iteration after it does not tell how far away the minimum is. */
void rec_stop_anew(struct rec_stopper *t, double objective, bool far);
/* x becomes the iterate that the rule chose, and the report gets its number and objective.  true: that iterate is not
 * the last one. */
bool rec_stop_end(struct rec_stopper *t, float *x);

#endif
