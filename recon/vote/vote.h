/* vote.h - which cameras of a frame set are believed.
 *
 * What the cameras see is one flame, so there is a volume that all their pictures fit.  On the coarsest grid
 * of S (16 to 31 voxels a side), with pictures averaged to its bins and their channels added up,
 *     x(C) = argmin over x >= 0 of  sum over c in C of  m_c || A_c x - b_c ||^2,
 *     R(C) = sum over c in C of  m_c || K (A_c x(C) - b_c) ||^2                                     (1)
 *     G(c) = ( R(all) - R(all but c) ) / P - nu_c                                                   (2)
 * is what it costs to believe camera c, as a share of P, the median of m_c ||b_c||^2: nothing for a camera
 * that fits the others, however few they are, since x is free to fit it too; for one that does not, about
 * the light that is in the wrong place.  m_c: the cameras' magnifications made equal; K = [1 2 1]'[1 2 1]/16:
 * thin sheets are finer than this grid, and what is wrong with a camera is not.  x lives where at most two
 * cameras (of six and more; else one) are dark and at least two are lit.
 *     c is out  when  G(c) > G(k) for all other k  and
 *     G(c) > 0.03 + 1.25 max over k of G(k) + nu_c / 2                                              (3)
 * nu_c: what noise alone has of ||K b_c||^2, over P.  Then the rest is looked at in the same way; two at
 * once, each judged without the other, where no one stands out (NUMERICS.md 9: where the constants are
 * from, what is missed).
 * Where R(x) of some x is under what (3) allows at least, nobody is asked: all fit it.
 *     c is frozen  when  it sent the same bits four times while most of the others' pictures changed   (4)
 * and is out for that, whatever it costs: the one thing that a verdict takes from earlier sets unless `hold` is set.
 * Fewer than four cameras: no vote.  Nobody lit, or fewer than three: nothing to judge by.
 * Source: the jackknife (Quenouille 1956, Tukey 1958) on the misfit; (1) begun by sweeps of SART (Andersen & Kak
 * 1984), then accelerated projected gradients with the step of SIRT (Beck & Teboulle 2009; O'Donoghue & Candes 2015:
 * restarts).
 * Threads: one frame set per object at a time; parallel inside, the same verdict for any number of threads.
 * Allocates nothing after rec_vote_new.  Cost: a look at the silhouettes and at what is lit of the pictures, two sweeps
 * on the coarsest grid, 0.4 ms of one processor at 64^3; where cameras are asked 1 + cameras times six iterations, four
 * times that. */
#ifndef REC_VOTE_H
#define REC_VOTE_H
#include "recon/solve/problem.h"
#include "recon/vote/verdict.h"

#define REC_VOTE_LEAST 4 /* cameras; fewer do not vote */

struct rec_vote_set {
    int channels; /* 1 or 3 */
    const struct rec_pictures *in;
    const uint8_t *lit;  /* [rows] silhouettes, 0/1 */
    const bool *present; /* [cameras] */
    const float *noise;  /* [cameras] variance of a bin, the sum over its channels */
};

typedef struct rec_vote rec_vote;

/* hold: 0, or a camera that went out is back only after that many sets in a row in which it costs less than
 * half of what would put it out; sets without a flame do not count.  Then a verdict depends on earlier sets, and
 * all cameras are asked in every (hold / 3)th set only, or when those that are believed fit worse by half of 0.03 than
 * when they were asked: in between, who is out stays out and who is torn stays torn.
 * Borrows S, k, pool.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_vote_new(const rec_sysmat *S, const struct rec_kernels *k,
                                    pvx_pool *pool, uint32_t hold, rec_vote **out);
void rec_vote_free(rec_vote **v);

/* Votes over one frame set; r as for rec_subsys_restrict. */
void rec_vote_take(rec_vote *v, struct rec_restrictor *r, const struct rec_vote_set *set,
                   struct rec_verdict *out);

#endif
