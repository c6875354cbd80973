/* share.h - volumes in shared memory as NanoVDB, for programs of this host (pyrovox_share.h reads them).
 *
 * Grids and notes are those of a .nvdb (openvdb_shim.h), z up, in metres.  A slot has room for any volume of the
 * grid, even with every brick lit.  A volume of a larger grid, and the first one with error bars, begins a new segment
 * under the same name.
 * Threads: one. */
#ifndef VOL_SHARE_H
#define VOL_SHARE_H
#include <sys/types.h>

#include "daemon/volumes/volumes.h"

struct vol_share_config {
    const char *name;
    mode_t mode; /* 0600, 0640, 0644 */
    bool split;  /* red, green, blue instead of one grid of vectors */
};
typedef struct vol_share vol_share;
/* Takes the name.  Errors: those of vol_segment_new; PVX_EUNSUP: the module is not installed. */
PVX_MUST_CHECK pvx_err vol_share_new(const struct vol_share_config *c, vol_share **out,
                                     struct pvx_diag *d);
/* Makes v, of a session that began with `start`, the newest volume.  PVX_ENOSPC: /dev/shm is full; the one before
 * stays the newest, and the next may find room.  PVX_EBUSY, PVX_EPERM: another process or user has taken the name. */
PVX_MUST_CHECK pvx_err vol_share_put(vol_share *s, const struct pvp_start *start,
                                     const struct vol_volume *v, struct pvx_diag *d);
/* Removes the name and tells the readers. */
void vol_share_free(vol_share **s);
#endif
