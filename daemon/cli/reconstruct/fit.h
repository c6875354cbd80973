/* fit.h - `pyrovox reconstruct --fit-volume`: the tightest box around the flame of a recording. */
#ifndef RECONSTRUCT_FIT_H
#define RECONSTRUCT_FIT_H
#include "daemon/cli/common/frames_in.h"
#include "daemon/cli/reconstruct/options.h"
#include "recon/carve/fit.h"

/* Find the box, print it on stderr, set rig->grid (--grid then applies to the fitted box) and write --save-rig.
 * Errors: PVX_ENOENT: no flame, or the cameras do not agree on it; PVX_ECANCELED; those of the files. */
PVX_MUST_CHECK pvx_err reconstruct_fit(const struct reconstruct_options *o, struct frames_in *in,
                                       const struct rec_frame_params *p, pvx_pool *pool,
                                       struct rec_rig *rig, struct pvx_diag *d);

#endif
