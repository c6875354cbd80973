/* volumes_out.h - the volumes of `pyrovox reconstruct` as one HDF5 recording (daemon/VOLUMES.md).
 * Threads: one at a time. */
#ifndef CLI_VOLUMES_OUT_H
#define CLI_VOLUMES_OUT_H
#include "daemon/pipeline/pipeline.h"
#include "daemon/volumes/volumes.h"

typedef struct volumes_out volumes_out;
#define VOLUMES_OUT_OPTIONS "# options of pyrovox reconstruct\n" /* first line of /config */
/* Make a new file.  An existing file is not overwritten.  rig: as it is used for solving.  session: the same for all
 * parts of a recording, otherwise any number.  options: one a line.  Errors: those of vol_writer_open. */
PVX_MUST_CHECK pvx_err volumes_out_new(const char *path, const struct rec_rig *rig, int nch,
                                       uint64_t session, const char *options, volumes_out **out,
                                       struct pvx_diag *d);
/* Copy all whole volumes of an earlier recording of the same rig.  *last: number of the last set, unchanged if none.
 * Errors: PVX_ESTALE (it is of another rig), those of vol_reader_open, vol_writer_put; PVX_ECANCELED. */
PVX_MUST_CHECK pvx_err volumes_out_copy(volumes_out *o, const char *from, uint64_t *n,
                                        uint64_t *last, struct pvx_diag *d);
/* Write the solved set of a slot, or a gap if it was not solved. */
PVX_MUST_CHECK pvx_err volumes_out_put(volumes_out *o, const struct dmn_slot *s,
                                       struct pvx_diag *d);
/* After PVX_OK the file is whole.  *o is freed in each case. */
pvx_err volumes_out_close(volumes_out **o, struct pvx_diag *d);
#endif
