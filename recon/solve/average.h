/* average.h - gain and aim of a rig's cameras, averaged over frame sets.
 *
 * Cameras stand still, and each set sees them with an error of its own: what its volume misses.  So the corrections
 * of selfcal.h are averaged.  Set k gives of a camera
 *     z_k = what was applied in it, plus the step (2) to (5) of selfcal.h from its residual,
 * z the log of a gain or a shift in bins of the finest grid, with C_k of (6) there.  So a mean that was applied and
 * is not quite right draws the next sets to the right one.  `block` sets in a row make a block, because a flame
 * hardly changes from one to the next, and they share their error.  With s the size that matters
 * (REC_SELFCAL_..._LEAST) and p the numbers in z,
 *     w_k = 1 / (tr C_k / p + s^2),   z_b = sum_b w_k z_k / w_b,   w_b = sum_b w_k
 *     m = sum w_b z_b / sum w_b,   n = (sum w_b)^2 / sum w_b^2
 *     C = 1 / (n - 1)  sum w_b (z_b - m)(z_b - m)' / sum w_b                                        (1)
 * or, where it is larger by its trace, the mean of C_k over n: sets of a flame that stands still share an error that
 * does not show between them.  m is then without what no picture shows, (5) of selfcal.h and the mean of 1/g.  A camera
 * needs REC_AVERAGE_LEAST blocks.  With t^2 = m' C^-1 m and v = n - 1,
 *     q = v ln(1 + t^2 / v) ((8 v + 1) / (8 v + 3))^2 of gains,   q = (v - 1) ln(1 + t^2 / v) of shifts  (2)
 * are chi square of p degrees when nothing is wrong.  Their sum over N cameras, of N - 1 or 2 N - 3 degrees, is the
 * test.  Beyond REC_AVERAGE_SIGMAS and with a size (8) of selfcal.h that matters, m is applied to all sets, and no
 * longer when its size is below half of that.  Until then no bit of a set changes.
 * A block of which one camera is beyond (1) by chance of 1 in 10^6 and by REC_AVERAGE_TOUCHED, and the next block too:
 * somebody touched it.  All that it said before is forgotten, of the other cameras what these two blocks say.
 * Three phases.  Live: the last `blocks` blocks count, and sets correct themselves until there is a mean.  Learning, for
 * a recording: blocks are sets.  In the first round sets correct themselves by their gate.  If a mean passes, every
 * set of the next round corrects itself without a gate, from the mean.  Not at once: where the model fails, as beside
 * a mask, a set that corrects itself without a gate goes further than its first step.  Fixed: what was learnt is
 * applied, and nothing is estimated.
 * The watch of the daemon (recon/check/drift.h) sees pictures as they come, so its alarm speaks as before.
 * Not in it: sets that estimate nothing (mosaics, fewer than REC_SELFCAL_LEAST cameras), sets that their deadline ended
 * before V was first renewed (renewal.h), cameras that are absent or voted out.
 * Source: (2) for two numbers is exact (Hotelling's T^2), for one D. L. Wallace, Ann. Math. Stat. 30:1121, 1959.
 * Threads: any, of several solvers at once.  Allocates nothing after rec_average_new.  The order of the sets decides
 * the last bits. */
#ifndef REC_AVERAGE_H
#define REC_AVERAGE_H
#include "recon/solve/selfcal.h"

typedef struct rec_average rec_average;

#define REC_AVERAGE_BLOCK         16 /* sets; live */
#define REC_AVERAGE_BLOCKS        32
#define REC_AVERAGE_LEAST         4
#define REC_AVERAGE_SIGMAS        3.0
#define REC_AVERAGE_TOUCHED_GAIN  0.05
#define REC_AVERAGE_TOUCHED_SHIFT 0.3 /* bins */

/* For cameras of bins of `binning` raw pixels.  block: sets; blocks: that are kept.  Errors: PVX_ENOMEM.
 * Owner: caller. */
PVX_MUST_CHECK pvx_err rec_average_new(size_t cameras, int32_t binning, uint32_t block,
                                       uint32_t blocks, rec_average **out);
void rec_average_free(rec_average **a);

/* A round of learning begins from what the last one gave. */
void rec_average_learn(rec_average *a);
/* Learning is over. */
void rec_average_fix(rec_average *a);

/* How the next set is corrected, and by what. */
enum rec_selfcal_how rec_average_given(rec_average *a, struct rec_selfcal_given *out);
/* A set's estimate, [cameras]. */
void rec_average_add(rec_average *a, const struct rec_selfcal_look *look);
/* What is known.  report.sets 0: nothing yet. */
void rec_average_tell(rec_average *a, struct rec_selfcal_report *out);

#endif
