/* selfcal.h - the default solver corrects gain and aim of the cameras while it solves.
 *
 * A real camera's gain is off by some percent and its pose by a fraction of a pixel.  Every camera c gets a factor g_c
 * and a shift d_c of its picture; the solver sees
 *     b_c(u) = g_c b_raw,c(u + d_c),      b_raw between bins by Catmull-Rom                         (1)
 * They come from what an iterate leaves, r = A x - b.  Over the tiles t of a picture, all channels pooled, with
 * m = (b + A x) / 2,
 *     B = sum w b,  R = sum w r,  M = sum w grad m,
 *     G = sum w b grad m,  H = sum w grad m grad m',  y = sum w r grad m
 *     a = sum_t R / sum_t B                                                                         (2)
 *     d = (sum_t H)^-1 sum_t (y - a G)                                                              (3)
 *     a = sum_t (R - M'd) / sum_t B;    g_c *= 1 + a,   d_c += d                                    (4)
 * The gain comes from sums, because blur moves light but keeps its sum: regressed on bins, a camera that looks along
 * thin sheets seems too bright, since no volume is as sharp as they are.
 * What no picture can show is taken out: gains have the mean of 1/g_c = 1, and of the shifts the part
 *     T = argmin sum_c |d_c - J_c T|^2                                                              (5)
 * goes, J_c: how the picture of a voxel moves with it.  Without this the volume drifts.
 * Residuals come from the model more than from noise, and neighbours share them, so their size says little about the
 * error of a and d.  The scatter over tiles does: with e_t what (2) to (4) leave of a tile's equations,
 *     C_a = n / (n - 1) sum_t e_t^2 / (sum_t B)^2,   C_d = n / (n - 2) (sum H)^-1 sum_t e_t e_t' (sum H)^-1    (6)
 * with n the number of tiles that count, (sum q)^2 / sum q^2 of q = B and tr H.  A correction is made only if
 *     F = 1/f sum_c d_c' C_c^-1 d_c,   f = N - 1 for gains, 2 N - 3 for shifts, N cameras              (7)
 * lies so many sigma above chance, by the F distribution of f and the tiles' degrees of freedom, and if it matters:
 * the mean square of log g_c, or of |d_c| in bins of the finest grid, weighed by what is known of each camera,
 *     k sum_c x_c' C_c^-1 x_c / sum_c (tr C_c^-1 / k),   k = 1 for gains, 2 for shifts                 (8)
 * lies above the square of REC_SELFCAL_GAIN_LEAST or REC_SELFCAL_SHIFT_LEAST.  What a model misses, as beside a mask,
 * can be beyond chance though it is small.  Otherwise no bit of the solution changes.  The two limits of (7) differ:
 * what a tile lacks of light its neighbours have, so the scatter of R overstates the error of a gain, and exact rigs
 * lie below chance (NUMERICS.md has the figures).
 * When: at the end of the second finest grid; on the finest at the first renewal of the weights (renewal.h), unless
 * the former test lay below REC_SELFCAL_NEAR; and where a correction is made, at the next renewal.
 * None for weights per channel (mosaics), where a channel's bins are not neighbours, and for fewer than
 * REC_SELFCAL_LEAST cameras.  Absent cameras and those that were voted out are not in it.  Rows that are lower bounds
 * (bound.h) tell nothing here.  Their bounds follow the gain, not the shift: all have the value of a saturated pixel,
 * so that a shift changes only the rim.
 * Sets of one rig correct each other's noise: average.h.
 * Source: gauge and statistics are standard (cluster-robust variance: Liang & Zeger, Biometrika 73:13, 1986); the
 * arrangement is our own.
 * Threads: one problem at a time; same bits for any number.  Allocates nothing after rec_selfcal_new. */
#ifndef REC_SELFCAL_H
#define REC_SELFCAL_H
#include "recon/solve/params.h"
#include "recon/solve/problem.h"

typedef struct rec_selfcal rec_selfcal;

#define REC_SELFCAL_SIDE  16 /* tiles along a picture's longer side, at most */
#define REC_SELFCAL_TILES (REC_SELFCAL_SIDE * REC_SELFCAL_SIDE)
/* Bins along a tile of a picture of bw x bh bins. */
static inline size_t rec_selfcal_tile(size_t bw, size_t bh)
{
    size_t side = (bw > bh ? bw : bh) / REC_SELFCAL_SIDE + 1;
    return side < 4 ? 4 : side;
}
#define REC_SELFCAL_SUMS \
    11 /* of a tile: B, R, M, G (u, v each), H (uu, uv, vv), y (u, v); u: across, v: down */

#define REC_SELFCAL_GAIN_SIGMAS  2.0
#define REC_SELFCAL_SHIFT_SIGMAS 5.0
#define REC_SELFCAL_GAIN_LEAST   0.02
#define REC_SELFCAL_SHIFT_LEAST  0.1 /* bins */
#define REC_SELFCAL_NEAR         1.0
#define REC_SELFCAL_LEAST        4

/* For frame sets of S and its coarser levels.  Errors: PVX_ENOMEM.  Owner: caller. */
PVX_MUST_CHECK pvx_err rec_selfcal_new(const rec_sysmat *S, rec_selfcal **out);
void rec_selfcal_free(rec_selfcal **s);
/* The problem, and those of coarser grids that start it, use `s`; NULL: none. */
void rec_selfcal_attach(rec_problem *pb, rec_selfcal *s);
/* Where the corrections of a set come from (average.h). */
enum rec_selfcal_how {
    REC_SELFCAL_ALONE, /* the set itself, by the gate */
    REC_SELFCAL_LEARN, /* the set itself, without a gate */
    REC_SELFCAL_GIVEN, /* `given`; what the set says of them is estimated when it is solved */
    REC_SELFCAL_FIXED  /* `given`; nothing is estimated */
};
struct rec_selfcal_given {
    bool gain, shift; /* these are corrected */
    struct {
        double gain, shift[2];
    } camera[REC_MAX_CAMERAS]; /* (1), bins of the finest grid */
};
/* A new frame set follows, whose corrections start from `given`; NULL: from none. */
void rec_selfcal_begin(rec_selfcal *s, enum rec_selfcal_mode mode, enum rec_selfcal_how how,
                       const struct rec_selfcal_given *given);

/* Writes the corrected pictures to the right-hand side of `pb`; nothing where there is no correction. */
void rec_selfcal_apply(rec_problem *pb);
/* Whether an estimate is due at a renewal of `pb`, of which `done` were before; at the end of its solve. */
bool rec_selfcal_due(const rec_problem *pb, uint32_t done);
bool rec_selfcal_due_last(const rec_problem *pb);
/* (2) to (8) from the residual r of an iterate; true: the corrections changed. */
bool rec_selfcal_estimate(rec_problem *pb, const float *r);

/* What came out, of the last estimate. */
void rec_selfcal_tell(const rec_selfcal *s, struct rec_selfcal_report *out);
/* The same of each camera [cameras of S], for average.h: what was applied and the step, bins of the finest grid. */
struct rec_selfcal_look {
    bool known;
    double log_gain, shift[2];
    double gain_var, var[3]; /* (6): uu, uv, vv; INFINITY: not determined */
    double J[2][3];          /* (5) */
};
void rec_selfcal_look(const rec_selfcal *s, struct rec_selfcal_look *out);

/* Takes out what no picture shows, of gains and shifts of the cameras that are in. */
struct rec_selfcal_place {
    bool in[2]; /* gain, shift */
    double gain, shift[2], J[2][3];
};
void rec_selfcal_anchor(struct rec_selfcal_place *p, size_t cameras);

#endif
