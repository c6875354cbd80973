/* thermal.h - a recording of temperatures in HDF5: fields with one number a voxel, NAN where there is none
 * (daemon/VOLUMES.md).
 *
 * Only chunks with a number are stored; the rest reads as NAN.  The file is marked closed at the end; what does not come
 * so far is removed.  Threads: one at a time. */
#ifndef VOL_THERMAL_H
#define VOL_THERMAL_H
#include "daemon/volumes/volumes.h"

#define VOL_THERMAL_FORMAT  "pyrovox temperature"
#define VOL_THERMAL_VERSION 1
#define VOL_THERMAL_MOST    8 /* fields */

struct vol_thermal_field {
    const char *name, *units;
    bool small; /* whole numbers 0..255, 0 where there is none: u8 */
};
/* How the errors of voxels go together: modes d_k of temperature and soot, as of emission (volumes.h).  The first
 * VOL_THERMAL_COMMON are the calibration's, which all sets have in common.  A voxel without a number has 0. */
#define VOL_THERMAL_COMMON 3u
struct vol_thermal_modes {
    uint32_t n;                 /* 0: not known, so that means have no bar */
    const float *kelvin, *soot; /* [n][n_bricks][8^3] */
};
typedef struct vol_thermal vol_thermal;
/* Makes `path`; its folder must be there.  PVX_EBUSY: it is there already. */
PVX_MUST_CHECK pvx_err vol_thermal_open(const char *path, const struct vol_head *head,
                                        const struct vol_thermal_field *field, int n,
                                        vol_thermal **out, struct pvx_diag *d);
/* An attribute of the file; text NULL: the number. */
PVX_MUST_CHECK pvx_err vol_thermal_note(vol_thermal *t, const char *key, double number,
                                        const char *text, struct pvx_diag *d);
/* One set: value[field] is [n_bricks][8^3], the bricks as in volumes.h.  PVX_ERANGE: another grid than the head's. */
PVX_MUST_CHECK pvx_err vol_thermal_put(vol_thermal *t, const struct vol_volume *v,
                                       const float *const *value,
                                       const struct vol_thermal_modes *modes, struct pvx_diag *d);
/* Finishes the file, or removes it (keep false).  Frees *t, whatever is returned. */
pvx_err vol_thermal_close(vol_thermal **t, bool keep, struct pvx_diag *d);
#endif
