/* spread.h - deviations of a volume, its modes, made into standard deviations: (1) and (5) of bars.h.
 *
 *     <v>_q = mean of v over the active voxels among q and its 26 neighbours                            (1)
 *     V = sum_k d_k^2,   sd^2 = 0.7 V + 0.3 <V>,   d_k becomes d_k min(1, sd / V^(1/2))                    (2)
 * so that (2) of bars.h never has more than sd says.
 * Threads: one frame at a time; same bits for any number.  Allocates nothing.  Private to recon/frame. */
#ifndef REC_FRAME_SPREAD_H
#define REC_FRAME_SPREAD_H
#include "recon/matrix/subsys.h"

struct rec_spread {
    const struct rec_subsys *a;
    float *work[2]; /* [voxels][cs] */
    float *inverse; /* [voxels] 1 / number of voxels of (1) */
    int32_t
        *place; /* [voxels of the grid] 1 + column; 0: none, and everywhere between two frames */
};

/* The active voxels of `a`; and their end. */
void rec_spread_begin(struct rec_spread *s, const struct rec_subsys *a);
void rec_spread_end(struct rec_spread *s);

/* out = <v>, [n][cs]; neither may be a work area. */
void rec_spread_mean(struct rec_spread *s, const float *v, float *out);
/* (2): modes [count][n][cs] in and out, sd [n][cs] out. */
void rec_spread_deviations(struct rec_spread *s, float *modes, uint32_t count, float *sd);

#endif
