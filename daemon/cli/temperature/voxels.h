/* voxels.h - the bricks of a volume with three channels to temperature and soot, or to ratios of the channels.
 *
 * The covariance of a voxel's emission is
 *     N_pq = sum_k d_kp d_kq for p != q,  N_pp = sd_p^2                                            (1)
 * by the recording's error bars and modes d_k (volumes.h; without modes N_pq = 0), or without bars
 *     N_pq = (noise max e)^2 for p = q, else 0                                                     (2)
 * with max e the largest emission of the volume, whatever its channel.
 * Where the recording has modes, so have temperature and soot: those of the calibration, with L L' = C (soot.h), then
 *     sum_q dT/de_q d_kq                                                                            (3)
 * for each mode of the emission.
 * Threads: the bricks are shared among the pool's; the result does not depend on their number. */
#ifndef CLI_TEMPERATURE_VOXELS_H
#define CLI_TEMPERATURE_VOXELS_H
#include "base/pool.h"
#include "recon/spectral/misfit.h"
#include "daemon/volumes/thermal.h"
#include "recon/spectral/soot.h"

enum { TEMPERATURE_FIELDS = 6, TEMPERATURE_RATIOS = 4 };
extern const struct vol_thermal_field temperature_fields[TEMPERATURE_FIELDS];
extern const struct vol_thermal_field temperature_ratios[TEMPERATURE_RATIOS];

struct temperature_voxels {
    const rec_soot *soot; /* NULL: ratios alone */
    double noise;         /* of (2); NAN: bars are needed */
    pvx_pool *pool;
    const float
        *tau; /* [bricks][8^3][3] what of the emission reached the cameras (shade.h); NULL: all */
    double L[9];                      /* of the calibration (misfit.h) */
    float *field[TEMPERATURE_FIELDS]; /* [bricks][8^3] of the volume done last */
    struct vol_thermal_modes modes;   /* of it, in mode[] */
    float *mode[2];
    uint32_t room;
    size_t mode_room; /* floats */
    struct temperature_sums {
        uint64_t state[REC_N_SOOT_STATES]; /* voxels with light */
        double soot, soot_kelvin;          /* sums over soot, of f (or 1) and of f T */
        double hottest, coldest;           /* K */
        double chi2, judged;               /* sum over soot and what is not, and their number */
        struct rec_misfit misfit;
        uint64_t own_bars; /* volumes that have error bars */
    } sums;                /* over all volumes */
};
/* One volume.  PVX_EINVAL: it has no bars, and noise is not known; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err temperature_do(struct temperature_voxels *t, const struct vol_volume *v,
                                      struct pvx_diag *d);
void temperature_fini(struct temperature_voxels *t);
#endif
