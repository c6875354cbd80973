/* renewal.h - when the default solver renews the weights of its objective, and how.
 *
 * The weights are V and lambda of (1) in pcg.c.  From a coarser solution they are renewed from the iterate that they
 * led to:
 *
 *     FOLLOW  the iterate follows the weights           -> DUE     x moved by at most 3 % of ||x||, or 3 iterations
 *     DUE     V by (2a) of pcg.c, lambda by lambda.c    -> FOLLOW  fewer than 3 renewals, or a restless one
 *                                                       -> FIXED   otherwise, and when the limit is reached
 *     FIXED   the weights stay: the minimiser is that of one convex problem
 *
 * A renewal is restless when it changes the lambda of some channel by more than a factor 2.  The limit is 6, on a
 * coarser grid 1: the next finer grid renews its weights (levels.h).  A start without knowledge begins FIXED:
 * V is 1, and its first iterates tell little about the flame.
 * Private to the solver. */
#ifndef REC_RENEWAL_H
#define REC_RENEWAL_H
#include "recon/solve/passes/pcg_pass.h"

struct rec_renewal {
    enum { REC_WEIGHTS_FOLLOW, REC_WEIGHTS_DUE, REC_WEIGHTS_FIXED } state;
    uint32_t limit;      /* renewals, at most */
    uint32_t done, last; /* number of renewals; the iteration of the last one */
    bool restless;       /* the last renewal was restless */
    bool patient;        /* every third iteration only */
};

void rec_renewal_begin(struct rec_renewal *r, const rec_problem *pb);
/* Whether the weights are due after iteration k, which moved x by the share `moved` of ||x||. */
bool rec_renewal_due(struct rec_renewal *r, uint32_t k, double moved);
/* Renews V, lambda, the penalty and lx of `t` from t->x; rwr: r'Wr.  This changes the objective and its gradient.
 * The directions stay: few columns change much, and (4) restarts a lane whose direction is no longer a descent
 * direction.  The penalty comes as that of rec_renewal_stiffen. */
void rec_renewal_take(struct rec_renewal *r, struct rec_pcg *t, const double rwr[4],
                      struct rec_solve_report *out);

/* Sets V from t->x and lx, then V lx; lit: the number of columns with x > 0, per lane.  The penalty comes to t->penalty,
 * on a card with the sums of the next operation (card.h). */
void rec_renewal_stiffen(struct rec_pcg *t, double lit[4]);

#endif
