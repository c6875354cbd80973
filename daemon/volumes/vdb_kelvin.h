/* vdb_kelvin.h - a volume in kelvin as a .vdb has it: `temperature` in kelvin, and `density` 1 where there is one.
 * Error bars are left out.  Threads: one at a time. */
#ifndef VOL_VDB_KELVIN_H
#define VOL_VDB_KELVIN_H
#include "daemon/volumes/volumes.h"

/* {0} is empty. */
struct vol_vdb_kelvin {
    float *density;
    uint32_t room; /* bricks */
};
/* out: borrowed from v, and until the next call.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err vol_vdb_kelvin(struct vol_vdb_kelvin *k, const struct vol_volume *v,
                                      struct vol_volume *out);
void vol_vdb_kelvin_free(struct vol_vdb_kelvin *k);
#endif
