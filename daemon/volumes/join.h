/* join.h - joins the HDF5 files of a recording's parts into one file: the columns are copied, /emission is a virtual
 * dataset over those of the parts (daemon/VOLUMES.md, "Joined").
 *
 * h5py, MATLAB, ParaView and vol_reader_open read it as any other recording.  A set that no part has is there as not
 * solved: its emission reads as NaN, its status as VOL_UNSOLVED; for vol_reader it is a gap.
 * Threads: any one. */
#ifndef VOL_JOIN_H
#define VOL_JOIN_H
#include "daemon/volumes/volumes.h"

#define VOL_UNSOLVED UINT32_MAX /* in /sets/status */

struct vol_join {
    const char *out; /* replaced when the new one is complete */
    const char *const *
        part; /* [n_parts] files in out's folder or below it.  Only closed ones count.  A set that several have
                                 is taken from the first */
    size_t n_parts;
    const uint64_t *number; /* [n] ascending: the sets of the whole recording */
    size_t n;
};
/* Only a joined file may be overwritten.  PVX_EBUSY: something else has that name. */
PVX_MUST_CHECK pvx_err vol_join_check(const char *path, struct pvx_diag *d);
/* *missing: number of sets that no part has.  Sets that a part lists as a gap are left out.
 * Errors: PVX_ENOENT (no part has a volume), PVX_EFORMAT (a part is of another recording: names it), those of
 * vol_reader_open for a part, PVX_EBUSY (out is there and is no joined recording), PVX_ENOSPC, PVX_EIO,
 * PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err vol_join(const struct vol_join *j, size_t *missing, struct pvx_diag *d);
#endif
