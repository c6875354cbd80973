/* vote.h - which cameras of a frame set are believed.
 *
 * All cameras see one flame, so there is a volume that fits all their pictures.  On the coarsest grid
 * of S (16 to 31 voxels a side), with pictures averaged to its bins and their channels added up,
 *     x(C) = argmin over x >= 0 of  sum over c in C of  m_c || A_c x - b_c ||^2,
 *     R(C) = sum over c in C of  m_c || K (A_c x(C) - b_c) ||^2                                     (1)
 *     G(c) = ( R(all) - R(all but c) ) / P - nu_c                                                   (2)
 * G(c) is the cost of believing camera c, as a share of P, the median of m_c ||b_c||^2.  It is 0 for a camera
 * that fits the others, however few they are, because x is free to fit it too.  For a camera that does not fit
 * it is about the light that is in the wrong place.  m_c makes the cameras' magnifications equal.  The low-pass
 * K = [1 2 1]'[1 2 1]/16 suppresses thin sheets, which are finer than this grid; the faults of a camera are not.
 * Where the picture of a voxel is more than two bins long (voxels longer one way than the others, bins smaller than
 * voxels), K is [1 2 .. s .. 2 1] / s^2 in that direction of the picture, s = 2 (whole bins - 1).
 * x may be positive only where at least two cameras are lit and at most two are dark (at most one if there are
 * fewer than six cameras).
 *     c is out  when  G(c) > G(k) for all other k  and
 *     G(c) > 0.03 + 1.25 max over k of G(k) + nu_c / 2                                              (3)
 * nu_c: the part of ||K b_c||^2 that is noise alone, over P.  The remaining cameras are then tested in the same
 * way.  If c's picture is that of the others times a factor of 1/1.75 to 1.75 (division by it halves c's misfit or
 * better), and the solve corrects gains, c stays: its picture is divided, and all are tested again.  When no single
 * camera stands out, two are tried at once, each judged without the other (NUMERICS.md 9: origin of the constants,
 * faults that are missed).
 * Fast path: if some x already has R(x) below the smallest threshold of (3), accept all cameras.
 *     c is frozen  when  it sent the same bits four times while most of the others' pictures changed   (4)
 * A frozen camera is out, whatever its cost.  Without `hold`, a verdict uses nothing else from earlier sets.
 * Fewer than four cameras: no vote.  Fewer than three lit cameras: nothing to judge by.
 * Source: the jackknife (Quenouille 1956, Tukey 1958) on the misfit; (1) begun by sweeps of SART (Andersen & Kak
 * 1984), then accelerated projected gradients with the step of SIRT (Beck & Teboulle 2009; O'Donoghue & Candes 2015:
 * restarts).
 * Threads: one frame set per object at a time; parallel inside, the same verdict for any number of threads.
 * Allocates nothing after rec_vote_new.  Cost: one pass over the silhouettes and the lit bins of the pictures, and two
 * sweeps on the coarsest grid: 0.4 ms of one processor at 64^3.  Testing every camera takes (1 + cameras) times six
 * iterations: four times that. */
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
    bool gains;          /* the solve corrects the cameras' gains */
};

typedef struct rec_vote rec_vote;

/* hold > 0: a camera that went out comes back only after `hold` sets in a row in which its cost is below half of the
 * limit that would put it out.  Sets without a flame do not count.  A verdict then depends on earlier sets.  Every
 * camera is tested only in each (hold / 3)th set, or when the misfit of the believed cameras has grown by half of
 * 0.03 since the last test.  In between, cameras that are out stay out, and a torn state stays torn.  hold = 0: each
 * set by itself.
 * Borrows S, k, pool.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_vote_new(const rec_sysmat *S, const struct rec_kernels *k,
                                    pvx_pool *pool, uint32_t hold, rec_vote **out);
void rec_vote_free(rec_vote **v);

/* Votes on one frame set; r as for rec_subsys_restrict. */
void rec_vote_take(rec_vote *v, struct rec_restrictor *r, const struct rec_vote_set *set,
                   struct rec_verdict *out);

#endif
