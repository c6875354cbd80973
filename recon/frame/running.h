/* running.h - error bars of a live sequence: one more solve a frame set, averaged along time.
 *
 * bars.h repeats the solve of one frame K times.  Here a frame is repeated once: the sets take turns with a group of
 * cameras left out (J) and a draw (D), each in the order of bars.h.  With x' the repeated solution and
 *     s_J = j^2 G   from (3) of bars.h,   s_D = DRAWN^2   from (4),   s_T = 1, without a solve, of (5)
 * a set gives squares s e^2, e = x' - x, and d^2 of T.  A flame moves, so the next sets are bright elsewhere.  But how
 * large the errors are for the light that is there stays: var x_q = R <x>_q with the mean <> over 3x3x3 active voxels
 * (spread.h), and R by parts of the volume.  For each kind k, over blocks B of 4x4x4 voxels,
 *     E_k(B) = sum over sets, newest first, of 0.9^i sum_(q in B) s e_q^2,   L_k(B) the same of <x>_q     (1)
 *     R_k(B) = (E_k(B+) + a E_k / L_k) / (L_k(B+) + a),   a = 0.05 max L_k(B+)                           (2)
 *     sd_q^2 = <x>_q sum_k c_k^2 R_k(B of q)                                                            (3)
 * B+: the block with its 26 neighbours; E_k, L_k without B: of the whole grid; c: the factor of Student's distribution
 * for (sum of weights)^2 / sum of squared weights solves, as in bars.h; 1 for T.  Sums over sets run over those that
 * had a solve of this kind.
 * J deviates from x, not from the mean of its group, because the groups are of different sets.
 * No modes: the bar of a sum over voxels does not follow from these bars.
 * Every choice was made on some moving flames and judged on others: NUMERICS.md, 21.
 * Source: our own arrangement of bars.h.
 * Cost: a fine-grid solve of the frame's iterations; for each volume one mean over 3x3x3.
 * Memory: 5 vectors over voxels and 30 over blocks in reserved address space, and what perturb.h takes.
 * Threads: add from one, bars from another one (neither waits for the other), outdate and age from any.  Same bits for
 * any number of threads, given the sequence of solves.  Allocates nothing after rec_running_new.  Private to Pyrovox. */
#ifndef REC_FRAME_RUNNING_H
#define REC_FRAME_RUNNING_H
#include "recon/frame/bars.h"
#include "recon/frame/inside.h"

#define REC_BARS_LATE 8 /* a doubt: too few solves are in the average */

typedef struct rec_running rec_running;

/* For frames of S with nch channels.  pause_ns: after so long without a solve the average begins anew.
 * Errors: PVX_ENOMEM.  Owner: caller. */
PVX_MUST_CHECK pvx_err rec_running_new(const rec_sysmat *S, int nch, int64_t pause_ns,
                                       rec_running **out, struct pvx_diag *d);
void rec_running_free(rec_running **r);

/* Whatever is in the average says no more about the volumes: settings were changed, or the cameras' corrections.  It
 * begins anew with a set of the new age. */
void rec_running_outdate(rec_running *r);
unsigned rec_running_age(const rec_running *r);

struct rec_running_set {
    uint64_t seed; /* a number of the set */
    int64_t t_ns;  /* of its exposure */
    unsigned age;  /* rec_running_age when the frame was solved */
};
/* Solves the frame once more, which was kept since its solve (inside.h), or which its solver has solved last.  false:
 * nothing was added, since the set is outdated or dark.  Only frames of the default solver. */
bool rec_running_add(rec_running *r, rec_frame *f, const struct rec_running_set *set);

/* Error bars of a solved frame, which need not have its systems, of a set of t_ns.  sd is NULL before the first
 * solve of each kind, and of an empty volume.  out->solves: those in the average.  Borrowed until the next
 * call.  pool: or NULL. */
void rec_running_bars(rec_running *r, const rec_frame *f, int64_t t_ns, pvx_pool *pool,
                      struct rec_bars_view *out);

#endif
