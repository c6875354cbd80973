/* stop.h - when an iteration ends and which iterate comes out.  The methods without a smoothness
 * term are semi-convergent: the error falls, and rises again once they fit the noise.
 *
 *     REC_STOP_DISCREPANCY  the first iterate with  ||W^(1/2) (A x - b)||^2 <= sigma^2 m     (1)
 *     REC_STOP_AUTO         (1), or the first whose residual is within twice the noise and fell by
 *                           less than own.stall of ||..||^2 in an iteration: where the basis can
 *                           not follow the flame (1) may never be met.  For the method that names
 *                           it: the L-curve, or the first that took less than own.gain of
 *                           the objective off
 *     REC_STOP_LCURVE       the corner of lcurve.h, believed 6 iterations later; the iterate there
 *     REC_STOP_ITERATIONS   the last iterate
 * m counts measured values, sigma is their noise: (1) is what the true x would leave.  Without
 * noise (sigma 0) (1) is not met and the bound on the iterations ends it; when sigma is unknown the
 * bound is one that suits a noise of 1 %.  p.iterations, where given, is the bound; the deadline
 * always is.
 * Why: on smooth and ragged flames, both bases, 0 to 5 % noise, more or fewer rays than
 * voxels, AUTO ends within 10 % of the least error on the way for every method here (mlem and osem
 * at 5 %: 24 %). Where details are finer than the voxels it goes on too long, by up to 1.5 times
 * the least error: the fit of what the basis can not show does not look like noise.  The L-curve
 * does worse everywhere: ||x|| hardly rises when x >= 0, so it has no upright arm.  So do rays held
 * out to judge the fit: the cameras that fit see them too, and they want some three times the
 * iterations.
 * Source: V. A. Morozov, Soviet Math. Dokl. 7:414, 1966.  Private to recon/solve. */
#ifndef REC_STOP_H
#define REC_STOP_H
#include "recon/solve/impl.h"

/* What a method decides for itself. */
struct rec_stop_own {
    bool corner;    /* AUTO is the L-curve */
    uint32_t most;  /* bound on the iterations */
    uint32_t blind; /* the same when AUTO has to do without sigma */
    double stall;   /* share of the residual^2 that an iteration has to take off */
    /* Under any rule, 0: not a rule of the method; where gain is, AUTO is these two alone.  Shares that an iteration
     * has to take off the objective, and of ||x|| that x has to move in it, more after a good start (stop.c). */
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
    double moved;      /* in: ||dx|| / ||x|| of the iteration that rec_stop_after is told of */
    double first;      /* the same of the first iteration */
    uint32_t hold;     /* until then neither gain nor still counts */
    double objective;  /* of the iterate before */
    bool corner;
    struct rec_lcurve curve;
    double best_objective, prev_objective; /* of pb->corner, pb->before */
};

/* For own.gain out->objective is that of the start. */
void rec_stop_begin(struct rec_stopper *t, rec_problem *pb, const struct rec_stop_own *own,
                    const struct rec_solve_params *p, struct rec_solve_report *out);
/* Whether there is to be another iteration; else the report's status says why not. */
bool rec_stop_next(struct rec_stopper *t);
/* Iterate number ++k is x, with this objective and ||W^(1/2) (A x - b)||^2; goes into the report
 * and to the trace.  True: it was the last. */
bool rec_stop_after(struct rec_stopper *t, const float *x, double objective, double residual2);
/* The method minimises another objective from here on, of this value; far: another one by so much that the first
 * iteration that follows does not tell how far away its least is. */
void rec_stop_anew(struct rec_stopper *t, double objective, bool far);
/* x becomes the iterate of the rule, its number and objective the report's.  true: that is not the last
 * one. */
bool rec_stop_end(struct rec_stopper *t, float *x);

#endif
