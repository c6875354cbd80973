/* measure.h - figures of a volume in a region, each with its standard deviation.
 *
 * x_q: emission of voxel q, the mean of the channels or one of them [1/m]; B: the voxels whose centre is in the region,
 * also those outside the hull, where x is 0; V: volume of a voxel.
 *     mean     1/|B| sum over B of x                                  [1/m]
 *     light    V sum over B of x                                      [m2]
 *     height   z below which 98 % of the light of B lies, linear within the layer that has it       [m]
 *     volume   V times the number of voxels of B with x > level       [m3]
 *     most     largest x of B                                         [1/m]
 * The covariance of x is sum_k d_k d_k' + diag(t^2) (volumes.h).  So for a sum with weights w
 *     var = sum_k (sum_q w_q d_kq)^2 + sum_q w_q^2 t_q^2                                             (1)
 * and for height and volume, which are no sums,
 *     var = sum_k ((F(x + d_k) - F(x - d_k)) / 2)^2                                                  (2)
 * which leaves t out.  Of several channels, d is their mean; t too, which is the most that it can be.
 * Without modes only a single voxel has a bar.
 * Threads: pure.  Cost: one pass over the bricks and, with bars, over each mode. */
#ifndef VOL_MEASURE_H
#define VOL_MEASURE_H
#include "daemon/volumes/volumes.h"

#define VOL_TOP \
    0.02 /* share of the light above the height, as in triggers (daemon/pipeline/triggers.h) */

enum vol_region_kind { VOL_ALL, VOL_BOX, VOL_SPHERE, VOL_SLICE };
struct vol_region {
    enum vol_region_kind kind;
    double at
        [6]; /* BOX: two corners x y z x y z; SPHERE: x y z r; SLICE: [1] on axis [0] (0 x, 1 y, 2 z); m */
};
struct vol_measure_how {
    struct vol_region region;
    int channel; /* -1: the mean of all */
    double level;
};
struct vol_figure {
    double v, sd; /* sd NAN: not known */
};
struct vol_measured {
    uint64_t voxels; /* |B| */
    bool bars;       /* the volume has error bars */
    bool modes;      /* and modes */
    uint32_t doubt;
    struct vol_figure mean, light, height, volume, most;
};
/* Errors: PVX_EINVAL (no voxel has its centre in the region, no such channel), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err vol_measure(const struct vol_volume *v, const struct vol_measure_how *how,
                                   struct vol_measured *out, struct pvx_diag *d);

/* The voxels of a grid whose centre is in a region; both are borrowed. */
struct vol_cells {
    const struct pvp_grid *g;
    const struct vol_region *r;
    double h[3];
    uint32_t lo[3], hi[3]; /* voxels that may be in it, the last one not included */
};
struct vol_cells vol_region_cells(const struct pvp_grid *g, const struct vol_region *r);
bool vol_cells_in(const struct vol_cells *m, const uint32_t at[3]);
uint64_t vol_cells_count(const struct vol_cells *m);
/* The sentence for a region without a voxel.  PVX_EINVAL. */
pvx_err vol_region_empty(const struct pvp_grid *g, struct pvx_diag *d);

/* "12.34 +- 0.81": two digits of the bar, and as many decimals of the value; four digits without a bar.  Very small
 * and very large numbers as "(1.23 +- 0.02)e-05". */
#define VOL_FIGURE_TEXT 64
const char *vol_figure_text(struct vol_figure f, char out[VOL_FIGURE_TEXT]);
#endif
