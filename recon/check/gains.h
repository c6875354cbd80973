/* gains.h - how bright the cameras of a rig are beside each other, by a flame that need not be wholly in their
 * pictures.
 *
 *     repeat: r_ck = sum p_c / sum b_c   of set k, over the pixels of weight that look through the hull of the
 *                                        others' volume; p_c: what c should see of that volume (unseen.h)
 *             g_c *= (median over k of r_ck)^0.85,   then all over their geometric mean           (1)
 * on two thirds of the frame sets, until no gain changes by more than REC_GAINS_SETTLED.  Sums, as the integrated
 * emission of light.h has them, as they do not mind blur and noise; but over what a camera sees, with the volume's
 * own perspective.  If the cameras differ by s_c, the volume of the others by about the mean of the others' s:
 * (n - 1) / n of r_c is right, 0.88 of eight, 0.75 of four.
 * Believed on the last third, which nothing was fitted on: the residual of views that were left out, their
 * brightness counted,
 *     E = ( mean_c || b_c - p_c ||^2 / || b_c ||^2 )^(1/2)                                               (2)
 * must get no worse.
 * Source: our own, as refine.h does with poses; figures: NUMERICS.md, 10.
 * Threads: as unseen.h; same bits for any number of threads. */
#ifndef REC_GAINS_H
#define REC_GAINS_H
#include "recon/check/judge.h"

#define REC_GAINS_ROUNDS  8
#define REC_GAINS_SETS    3
#define REC_GAINS_SETTLED 0.001

struct rec_gains_report {
    bool accepted;
    uint32_t rounds;
    size_t fitted, held_out;          /* sets */
    double error[2];                  /* E with the gains as they came, and as they were found */
    double noise;                     /* what of E noise alone makes, of the same sets */
    double changed[REC_GAINS_ROUNDS]; /* largest change of a gain's logarithm, of that round */
};

/* gain in: where to begin, of the rig's cameras in the source's one channel (the rig's own are not used), out:
 * the better ones if they are accepted, else as they were.  Their product, over cameras that see flame, is 1;
 * a camera that never does keeps its own.  Errors: PVX_EINVAL + diag: fewer than REC_GAINS_SETS sets or
 * REC_CHECK_LEAST cameras that see flame; PVX_ECANCELED; those of unseen.h; the source's. */
PVX_MUST_CHECK pvx_err rec_gains(const struct rec_rig *rig, const struct rec_unseen_params *p,
                                 pvx_pool *pool, const struct rec_check_source *s,
                                 double gain[REC_MAX_CAMERAS], struct rec_gains_report *out,
                                 struct pvx_diag *d);
#endif
