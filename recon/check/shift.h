/* shift.h - displacement of a picture against the expected picture.
 *
 * Per window W of a lattice over the picture, of smoothed pictures b (measured) and p (expected),
 *     alpha = sum b p_e / sum p_e p_e,   r(u) = b(u) - alpha p_e(u),   g = alpha grad p_e,   p_e(u) = p(u - e)
 *     A_W = sum g g',   v_W = A_W e - sum g r,   d = (sum A_W)^-1 sum v_W                              (1)
 * d [bins]: b(u + d) ~ alpha p(u).  e: result of two earlier such steps, which start from 0 or, if it is further than
 * a bin away, from the peak s of the correlation (2).  The gradient is that of p alone: with noise of b in it, A
 * would hold that noise squared and draw d towards e (noise of 5 % of the peak: by half of the remaining distance).
 * A and v are added up over frame sets as Wieneke (Exp. Fluids 45:549, 2008) adds up disparity maps: a window in
 * which one set determines little, or only one direction, counts accordingly.  Bins of weight 0 do not count.
 *     rho(s) = sum b(u + s) p(u) / sqrt(sum b(u + s)^2 sum p(u)^2)                                     (2)
 * Every window has the mean point X of the emission that shines into it, for rec_camera_nudged.
 * Threads: pure but for the work area.  Allocates nothing. */
#ifndef REC_SHIFT_H
#define REC_SHIFT_H
#include "recon/frame/frame.h"

#define REC_LATTICE_X 12
#define REC_LATTICE_Y 9
#define REC_LATTICE   (REC_LATTICE_X * REC_LATTICE_Y)

struct rec_window {
    double A[3], v[2]; /* xx, xy, yy; of (1) */
    double X[3], x;    /* sum of emission times place, of emission */
};

struct rec_lattice {
    struct rec_window w[REC_LATTICE];
};

/* Pictures of one camera, [bh][bw]. */
struct rec_pair {
    int32_t bw, bh;
    const float *b, *weight, *p;
};

/* Smoothed copy of in, by `passes` of [1 2 1]/4 along both axes; tmp [bh][bw]. */
void rec_smooth(const float *in, int32_t bw, int32_t bh, int passes, float *out, float *tmp);

/* (2), 0 where a picture is empty; flip: bit 0 b mirrored left to right, bit 1 top to bottom. */
double rec_correlation(const struct rec_pair *q, const int32_t s[2], unsigned flip);
/* Its peak within +-reach bins of `s`, into s; a coarse search comes first where reach is more than 8. */
double rec_correlation_peak(const struct rec_pair *q, int32_t reach, unsigned flip, int32_t s[2]);

/* Adds (1) of one set to `sum`; d[2]: the set's own d.  Returns alpha; 0: nothing visible, nothing added. */
double rec_shift_add(const struct rec_pair *q, const int32_t s[2], struct rec_lattice *sum,
                     double d[2]);
/* Adds X of (1): the volume's emission into the windows of the camera, with `binning` raw pixels to a bin's side. */
void rec_shift_points(const struct rec_sparse *v, const struct rec_camera *c, int32_t binning,
                      struct rec_lattice *sum);
/* d of (1) of window i alone, and tr(A); false: not determined. */
bool rec_shift_window(const struct rec_lattice *l, int i, double d[2], double *weight);
/* d of (1) of all windows; false: not determined along some direction. */
bool rec_shift_mean(const struct rec_lattice *l, double d[2]);

#endif
