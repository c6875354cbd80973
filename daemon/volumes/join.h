/* join.h - HDF5 recordings of parts of one recording, as one file: its columns are copied, its /emission is a virtual
 * dataset over theirs (daemon/VOLUMES.md, "Joined").
 *
 * h5py, MATLAB and ParaView read it as any other, vol_reader_open too.  A set that no part has is there as not solved:
 * its emission reads as NaN, its status as VOL_UNSOLVED; to vol_reader it is a gap.
 * Threads: any one. */
#ifndef VOL_JOIN_H
#define VOL_JOIN_H
#include "daemon/volumes/volumes.h"

#define VOL_UNSOLVED UINT32_MAX /* in /sets/status */

struct vol_join {
    const char *out; /* replaced when the new one is complete */
    const char *const *
        part; /* [n_parts] files in out's folder or below it, of which those that are closed count; of a
                                 set that several have the first one's */
    size_t n_parts;
    const uint64_t *number; /* [n] ascending: the sets that there are to be */
    size_t n;
};
/* Only what was joined before is written over: PVX_EBUSY, something else has that name. */
PVX_MUST_CHECK pvx_err vol_join_check(const char *path, struct pvx_diag *d);
/* *missing: of the sets, those that no part has; sets that a part lists as a gap are not wanted any more.
 * Errors: PVX_ENOENT (no part has a volume), PVX_EFORMAT (a part is of another recording: names it), those of
 * vol_reader_open for a part, PVX_EBUSY (out is there and is no joined recording), PVX_ENOSPC, PVX_EIO, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err vol_join(const struct vol_join *j, size_t *missing, struct pvx_diag *d);
#endif
