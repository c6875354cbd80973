/* modes.h - pictures of the board in another mode than those of the flame: unbinned, or the whole picture where the
 * flame's are a region.
 *
 * N is the binning, and the region begins at pixel (X, Y) of the binned picture.  Pixel centres are whole numbers.
 *     u = (u' + 1/2) / N - 1/2,   v likewise        corners found, before the rig is solved       (1)
 *     f = f' / N                                    follows from it
 *     cx = cx' - X,  cy = cy' - Y                   the rig's cameras, after it is solved          (2)
 * So lenses are solved on the whole picture, because their axis is near its middle.  Without a declaration all
 * pictures of a camera must have one size.  With it they may be the whole picture unbinned, the whole one binned, or
 * the region. */
#ifndef CALIBRATE_MODES_H
#define CALIBRATE_MODES_H
#include "daemon/cli/calibrate/look.h"

/* Declare a mode: "N" or "N,CAMERA", and "X,Y,W,H" or "X,Y,W,H,CAMERA".  Without CAMERA it holds for all cameras that
 * have none yet. */
PVX_MUST_CHECK pvx_err calibrate_mode_binning(struct calibrate_look *l, const char *text,
                                              struct pvx_diag *d);
PVX_MUST_CHECK pvx_err calibrate_mode_region(struct calibrate_look *l, const char *text,
                                             struct pvx_diag *d);

/* After the pictures were read: set the cameras' sizes, convert the corners by (1).  PVX_EINVAL names file and
 * camera. */
PVX_MUST_CHECK pvx_err calibrate_mode_sizes(struct calibrate_look *l, struct pvx_diag *d);
/* crop applies (2) to the cameras of a solved rig.  uncrop reverses (2) for the cameras of an older rig. */
void calibrate_mode_crop(const struct calibrate_look *l, struct rec_rig *rig);
void calibrate_mode_uncrop(const struct calibrate_look *l, struct rec_rig *old);
#endif
