/* meant.h - the mistake in a rig that explains why silhouettes contradict each other.
 *
 * With a right rig every lit bin of a camera is explained by a point of the volume that is lit in all cameras.
 *     A = mean over cameras of the share of the lit bins that such a point explains                       (1)
 * is near 1 then.  Each of these is tried: a camera's picture mirrored, upside down or turned by 180 degrees; all
 * pictures; the pictures of two cameras swapped; R, t and K of all cameras, or of one, read in another way
 * (recon/geom/blind.h).  One is named only if it leaves at most half of 1 - A, A of 0.9 or more, and less than two
 * thirds of what any other leaves.  Where the others that leave as little change the same camera, it is an instance.
 * Flames that look alike from all sides, and those that fill every picture, hide such mistakes: A stays near 1.
 * Threads: pure. */
#ifndef REC_MEANT_H
#define REC_MEANT_H
#include "recon/geom/rig.h"

#define REC_MEANT_TEXT 400

/* lit[c]: silhouettes of one frame set, [height / binning][width / binning], 0/1; NULL: missing.
 * text: one sentence; "": no mistake explains them clearly.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_rig_meant(const struct rec_rig *rig, int32_t binning,
                                     const uint8_t *const *lit, char text[REC_MEANT_TEXT]);

#endif
