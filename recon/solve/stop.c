#include "recon/solve/stop.h"

#include <math.h>

#define BEYOND 6   /* points after a corner before it is accepted */
#define NEAR   4.0 /* residual^2 over sigma^2 m from which a stall counts */

/* If the first iteration hardly moves x, the start was good, and further iterations bring less. */
#define GOOD_START 0.03 /* share of ||x|| */
#define THEN       1.5  /* own.still is multiplied by this from then on, */
#define AT_ONCE    2.0  /* and by this in the first iteration */

/* The squared residual that the noise is expected to leave; 0: unknown, or none. */
static double noise2_of(const rec_problem *pb)
{
    double sum = 0;
    for (int l = 0; l < pb->nch; l++) {
        if (pb->in.sigma[l] < 0)
            return 0;
        sum += pb->in.sigma[l] * pb->in.sigma[l] * rec_rows_of(pb, l);
    }
    return sum;
}

void rec_stop_begin(struct rec_stopper *t, rec_problem *pb, const struct rec_stop_own *own,
                    const struct rec_solve_params *p, struct rec_solve_report *out)
{
    enum rec_stop rule = p->stop;
    bool own_rule = rule == REC_STOP_AUTO;
    if (own_rule)
        rule = own->gain > 0 ? REC_STOP_ITERATIONS
               : own->corner ? REC_STOP_LCURVE
                             : REC_STOP_DISCREPANCY;
    *t = (struct rec_stopper){.pb = pb, .p = p, .out = out};
    t->corner = rule == REC_STOP_LCURVE;
    t->noise2 = rule == REC_STOP_DISCREPANCY ? noise2_of(pb) : 0;
    t->stall = own_rule && t->noise2 > 0 ? own->stall : 0;
    t->gain = own->gain;
    t->still = own->still;
    t->objective = out->objective;
    t->limit = rule == REC_STOP_DISCREPANCY && pb->in.sigma[0] < 0 ? own->blind : own->most;
    if (p->iterations > 0)
        t->limit = p->iterations;
}

bool rec_stop_next(struct rec_stopper *t)
{
    if (t->k < t->limit && !rec_late(t->p))
        return true;
    t->out->status = t->k < t->limit ? REC_DEADLINE : REC_MAX_ITER;
    return false;
}

bool rec_stop_after(struct rec_stopper *t, const float *x, double objective, double residual2)
{
    rec_problem *pb = t->pb;
    double residual = sqrt(residual2);
    t->k++;
    t->out->iterations = t->out->best = t->k;
    t->out->objective = objective;
    if (t->p->trace != NULL)
        t->p->trace(t->p->trace_ctx, t->k, x, objective, residual);
    bool done = t->noise2 > 0 && residual2 <= t->noise2;
    if (t->stall > 0 && t->k > 1 && residual2 <= NEAR * t->noise2)
        done = done || t->last - residual2 <= t->stall * residual2;
    t->last = residual2;
    if (t->corner) {
        if (rec_lcurve_add(&t->curve, t->k, residual, rec_norm_x(pb, x))) {
            float *swap = pb->corner;
            pb->corner = pb->before;
            pb->before = swap;
            t->best_objective = t->prev_objective;
        }
        done = rec_lcurve_done(&t->curve, t->k, BEYOND);
        rec_copy_x(pb, pb->before, x);
        t->prev_objective = objective;
    }
    bool slow = t->gain > 0 && t->objective - objective <= t->gain * objective;
    if (t->k == 1)
        t->first = t->moved;
    double still = t->still * (t->k == 1 ? AT_ONCE : t->first <= GOOD_START ? THEN : 1);
    slow = slow || (t->still > 0 && t->moved <= still);
    done = done || (slow && t->k >= t->hold);
    t->objective = objective;
    if (done)
        t->out->status = REC_CONVERGED;
    return done;
}

void rec_stop_anew(struct rec_stopper *t, double objective, bool far)
{
    t->objective = objective;
    t->hold = far ? t->k + 2 : t->hold;
}

bool rec_stop_end(struct rec_stopper *t, float *x)
{
    if (!t->corner || t->curve.best_k == 0)
        return false;
    rec_copy_x(t->pb, x, t->pb->corner);
    t->out->best = t->curve.best_k;
    t->out->objective = t->best_objective;
    return true;
}
