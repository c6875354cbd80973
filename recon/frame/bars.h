/* bars.h - error bars of a volume: one standard deviation per voxel and channel, and of any sum of voxels.
 *
 * The solve is repeated K times, each time with something else that could have been otherwise (perturb.h).  What the
 * results differ by are modes d_k: deviations that the truth may have from the volume x.  With them
 *     covariance of x = sum_k d_k d_k' + diag(t^2),   sd_q^2 = sum_k d_kq^2 + t_q^2                    (1)
 *     var(w'x) = sum_k (w'd_k)^2 + sum_q w_q^2 t_q^2     any sum over a region                         (2)
 * t^2 is sd^2 - sum d^2.  Four kinds of modes, N cameras believed:
 *     J  cameras are left out in G <= K/2 groups.  x_g is the volume without group g, m the mean of the x_g,
 *            d = j (x_g - m),   j^2 = JACK^2 (1 - 1/G) p^2 s,   p = max(1, (GAP - N)/(N - 1))           (3)
 *        1 - 1/G is the factor of the jackknife.  p: between few cameras there are wide gaps, about which each camera
 *        tells something new.  These modes hold what belongs to one camera (noise, pose, gain, lens, time) and, since
 *        what a new view changes is what the views before could not see, much of the detail that no view shows.
 *        s: the solve's iterations over those of J, at least 1.  Of iterations with the channels as one (blend.h) J makes
 *        half as many, and the deviation grows as the root of their number.
 *     D  n <= DRAWS draws of noise (perturb.h), of sigma^2 = r'Wr / (m - g), the evidence's noise: what the volume
 *        misses in the pictures, so the model's error too.  Volumes x_k:
 *            d = DRAWN (x_k - x) / sqrt n                                                              (4)
 *        About x, not about their mean: what noise adds to a volume that cannot be negative is an error too.  J has noise
 *        already: DRAWN is 0.4 for a sharp flame, and rises to 1 as R of (5) falls to 0.  There the draws also deviate by
 *        the prior, by a share that rises with the weight, because J moves little where the weight holds the volume.
 *        With too few cameras for J there is D alone: K draws of noise and prior, DRAWN is 1.
 *     T  texture, without a solve: detail that the volume has at the scale of a few voxels, as a measure of the finer
 *        detail that it has lost.  With << >> the mean over a neighbourhood, r the channel that is known best and u_c the
 *        mean diagonal of A'WA,
 *            d_c = f_c (x_r / <<x_r>> - 1) <<x_c>>                                                         (5)
 *            f_c = min(MOST, LOST lambda_c / u_c + UNSEEN (p^2 - 1)^(1/2)) min(1, R / ROUGH)
 *        lambda_c / u_c is how far noise has blurred a channel, p how much the views leave open.  R, the mean square of
 *        d_r / f_r over that of x_r, tells sharp flames from smooth ones, which have no detail to lose.  Lost detail of one
 *        place knows nothing of that of another, and all of it together is no light: each block of 8x8x8 voxels has a
 *        sign of its own, by chance.
 *     S  scale, without a solve.  A volume that cannot be negative makes light of noise, in all n voxels of the hull.
 *        The sum of a picture has no such light, so the difference of the sums measures it.  And self-calibration makes
 *        the gains equal, but their mean may be wrong: g are the gains that it has found.
 *            d = 1 (1'W (A x - b) / 1'W b) 1'x / n,    d = x (var(log g) / N)^(1/2)                     (6)
 * Few modes give each voxel's variance with a large error of its own.  So it is mixed with the mean over 3x3x3 voxels;
 * modes shrink where it falls, t^2 is the rest where it rises (spread.h).  Modes of J and D are longer by the factor by
 * which Student's distribution is wider than the normal one.
 * The iterations of a repeated solve are about those of the solve, since also an iterate that stops early is more
 * certain than a minimiser.
 * Every factor was chosen on some flames and judged on others: NUMERICS.md, 21, which also says what is not in it.
 * Source: the jackknife is Tukey's (Miller, Biometrika 61:1, 1974); perturb.h for the draws; the arrangement is our own.
 * Cost: NUMERICS.md, 21.
 * Memory: K + 6 vectors over voxels in reserved address space.
 * Threads: as rec_frame_solve; same bits for any number.  Allocates nothing after ..._new.  No bit of the volume
 * changes. */
#ifndef REC_FRAME_BARS_H
#define REC_FRAME_BARS_H
#include "recon/frame/frame.h"

#ifdef __cplusplus
extern "C" {
#endif

#define REC_BARS_LEAST   4
#define REC_BARS_MOST    64
#define REC_BARS_USUAL   16
#define REC_BARS_LEAVES  4 /* cameras; with fewer, none is left out */
#define REC_BARS_CAMERAS 5 /* with fewer, there is a doubt */

/* Why bars may be too small. */
enum {
    REC_BARS_POOR_FIT = 1,    /* the volume misses the pictures by far more than their noise */
    REC_BARS_FEW_CAMERAS = 2, /* fewer than REC_BARS_CAMERAS are believed */
    REC_BARS_FINE =
        4, /* R of (5) is above 0.4: the flame is as fine as its voxels, and likely finer */
    REC_BARS_BLURRED = 16 /* noise hides detail: f_r of (5) by the weight alone is above 0.5 */
};

typedef struct rec_bars rec_bars;

/* For frames of S with nch channels, at most K solves.  Errors: PVX_EINVAL (K), PVX_ENOMEM.  Owner: caller. */
PVX_MUST_CHECK pvx_err rec_bars_new(const rec_sysmat *S, int nch, uint32_t K, rec_bars **out,
                                    struct pvx_diag *d);
void rec_bars_free(rec_bars **b);

/* On the frame's active voxels, in the units of the volume; borrowed until the next call. */
struct rec_bars_view {
    int nch, cs;
    int32_t n;
    const int32_t *index; /* [n] as in rec_sparse */
    const float *sd; /* [n][cs] one standard deviation; NULL: no bars, since nothing was solved */
    uint32_t n_modes;
    const float *modes; /* [n_modes][n][cs] */
    uint32_t doubt;     /* REC_BARS_* */
    uint32_t solves, iterations;
};
/* Error bars of the frame that f's solver has solved last, by the default solver; seed: a number of the set, the same
 * bars for the same number.  The frame must not have been carved or reset since.  Errors: PVX_EUNSUP: another solver,
 * or a graphics card. */
PVX_MUST_CHECK pvx_err rec_frame_bars(rec_frame *f, rec_bars *b, uint64_t seed,
                                      struct rec_bars_view *out);

#ifdef __cplusplus
}
#endif
#endif
