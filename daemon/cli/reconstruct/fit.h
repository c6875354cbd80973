/* fit.h - `pyrovox reconstruct --fit-volume`: the box that the flame of a recording fills. */
#ifndef RECONSTRUCT_FIT_H
#define RECONSTRUCT_FIT_H
#include "daemon/cli/common/frames_in.h"
#include "daemon/cli/reconstruct/options.h"
#include "recon/carve/fit.h"

/* Look at the recording, say on stderr what was found, put the grid to use into rig->grid (the --grid
 * of the options counts for the fitted box) and write --save-rig.
 * Errors: PVX_ENOENT: no flame, or one that the cameras do not agree on; PVX_ECANCELED; files'. */
PVX_MUST_CHECK pvx_err reconstruct_fit(const struct reconstruct_options *o, struct frames_in *in,
                                       const struct rec_frame_params *p, pvx_pool *pool,
                                       struct rec_rig *rig, struct pvx_diag *d);

#endif
