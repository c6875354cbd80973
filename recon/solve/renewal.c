#include "recon/solve/renewal.h"

#include <math.h>
#include <string.h>

#include "recon/solve/card.h"

#define FOLLOWED 3    /* iterations after which the weights are due, */
#define SETTLED  0.03 /* or sooner, when x moved by at most this share of ||x|| */
#define ENOUGH   3    /* renewals, unless */
#define RESTLESS 2.0  /* the last one changed some lambda by more than this factor */

void rec_renewal_begin(struct rec_renewal *r, const rec_problem *pb)
{
    *r = (struct rec_renewal){.limit = pb->renewals, .state = REC_WEIGHTS_FIXED};
    if (pb->start == REC_START_FITS && r->limit > 0)
        r->state = REC_WEIGHTS_FOLLOW;
}

bool rec_renewal_due(struct rec_renewal *r, uint32_t k, double moved)
{
    bool settled = moved <= SETTLED && !r->patient;
    if (r->state == REC_WEIGHTS_FOLLOW && (settled || k >= r->last + FOLLOWED))
        r->state = REC_WEIGHTS_DUE;
    return r->state == REC_WEIGHTS_DUE;
}

void rec_renewal_stiffen(struct rec_pcg *t, double lit[4])
{
    double sums[3][4];
    rec_pcg_pass(t, REC_PASS_BRIGHTNESS, sums);
    t->usual = sums[0][0] > 0 ? sums[1][0] / sums[0][0] : 0;
    memcpy(lit, sums[2], sizeof sums[2]);
    rec_card_later(t->pb->a);
    rec_pcg_pass(t, REC_PASS_STIFFNESS, &t->penalty);
}

/* Whether the lambda of some channel changed by more than the factor RESTLESS. */
static bool renewal_restless(const struct rec_pcg *t, const double before[4])
{
    bool restless = false;
    for (int l = 0; l < t->pb->nch; l++)
        restless = restless || fabs(log(t->lambda[l] / before[l])) > log(RESTLESS);
    return restless;
}

void rec_renewal_take(struct rec_renewal *r, struct rec_pcg *t, const double rwr[4],
                      struct rec_solve_report *out)
{
    double penalty[4], lit[4], before[4];
    memcpy(before, t->lambda, sizeof before);
    memcpy(penalty, t->penalty, sizeof penalty);
    rec_renewal_stiffen(t, lit);
    rec_problem_reweigh(t->pb, rwr, penalty, lit, t->lambda); /* from the former V's penalty */
    r->restless = renewal_restless(t, before);
    r->last = out->iterations;
    out->renewed[r->done++] = r->last;
    out->renewals = r->done;
    r->state = r->done < r->limit && (r->done < ENOUGH || r->restless) ? REC_WEIGHTS_FOLLOW
                                                                       : REC_WEIGHTS_FIXED;
}
