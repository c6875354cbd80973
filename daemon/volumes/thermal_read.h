/* thermal_read.h - reads a recording of temperatures (thermal.h), set by set.
 * Types, ranks and sizes are checked before a byte is used.  Threads: one at a time. */
#ifndef VOL_THERMAL_READ_H
#define VOL_THERMAL_READ_H
#include "daemon/volumes/thermal.h"

/* Whether path says that it is one. */
bool vol_is_thermal(const char *path);

typedef struct vol_thermal_reader vol_thermal_reader;
/* Errors: PVX_ENOENT, PVX_EFORMAT (damaged, not complete, or ratios without temperatures), PVX_EVERSION, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err vol_thermal_read(const char *path, vol_thermal_reader **out,
                                        struct pvx_diag *d);
void vol_thermal_read_close(vol_thermal_reader **r);
const struct pvp_grid *vol_thermal_grid(const vol_thermal_reader *r);
uint64_t vol_thermal_count(const vol_thermal_reader *r);

enum { VOL_KELVIN, VOL_KELVIN_SD, VOL_SOOT, VOL_SOOT_SD, VOL_THERMAL_READ };
struct vol_thermal_set {
    uint64_t number;
    int64_t t_exposure_ns;
    const float *value[VOL_THERMAL_READ]; /* [nz][ny][nx], NAN where there is none; K and ppm */
    uint32_t n_modes;                     /* 0: not known, so that means have no bar */
};
/* Set k; borrowed until the next call. */
PVX_MUST_CHECK pvx_err vol_thermal_get(vol_thermal_reader *r, uint64_t k,
                                       struct vol_thermal_set *out, struct pvx_diag *d);
/* Mode m of set k, of VOL_KELVIN or VOL_SOOT: [nz][ny][nx], 0 where there is no number; borrowed until the next call. */
PVX_MUST_CHECK pvx_err vol_thermal_mode(vol_thermal_reader *r, uint64_t k, int field, uint32_t m,
                                        const float **out, struct pvx_diag *d);
#endif
