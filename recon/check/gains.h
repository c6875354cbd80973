/* gains.h - relative brightness of the cameras of a rig, from a flame that need not be wholly in their pictures.
 *
 *     repeat: r_ck = sum p_c / sum b_c   of set k, over the pixels of weight that look through the hull of the
 *                                        others' volume; p_c: what c should see of that volume (unseen.h)
 *             g_c *= (median over k of r_ck)^0.85,   then all divided by their geometric mean          (1)
 * on two thirds of the frame sets, until no gain changes by more than REC_GAINS_SETTLED.  As in light.h these are
 * sums, the integrated emission, which blur and noise do not change.  Here they cover what a camera sees, with the
 * volume's own perspective.  If the cameras differ by s_c, the volume of the others is off by about the mean of their
 * s.  So (n - 1) / n of log r_c is right: 0.88 for eight cameras, 0.75 for four.
 * The result is judged on the last third, which was not used for the fit: the residual of views that were left out,
 * brightness included,
 *     E = ( mean_c || b_c - p_c ||^2 / || b_c ||^2 )^(1/2)                                               (2)
 * must not increase.
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
    double error[2];                  /* E with the given gains, and with the gains found */
    double noise;                     /* the part of E that noise alone makes, of the same sets */
    double changed[REC_GAINS_ROUNDS]; /* largest change of a gain's logarithm, of that round */
};

/* gain in: the start, for the rig's cameras in the source's one channel (the rig's own gains are not used).
 * gain out: the better ones if they are accepted, else unchanged.  Their product, over cameras that see flame, is 1;
 * a camera that never sees flame keeps its own.  Errors: PVX_EINVAL + diag: fewer than REC_GAINS_SETS sets or
 * REC_CHECK_LEAST cameras that see flame; PVX_ECANCELED; those of unseen.h; the source's. */
PVX_MUST_CHECK pvx_err rec_gains(const struct rec_rig *rig, const struct rec_unseen_params *p,
                                 pvx_pool *pool, const struct rec_check_source *s,
                                 double gain[REC_MAX_CAMERAS], struct rec_gains_report *out,
                                 struct pvx_diag *d);
#endif
