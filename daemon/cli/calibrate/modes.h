/* modes.h - pictures of the board that are not as those of the flame will be: unbinned, or whole where the
 * flame's are a region.
 *
 * With binning N and a region that begins at pixel (X, Y) of the binned picture, pixel centres being whole numbers,
 *     u = (u' + 1/2) / N - 1/2,   v likewise        corners found, before the rig is solved       (1)
 *     f = f' / N                                    follows from it
 *     cx = cx' - X,  cy = cy' - Y                   the rig's cameras, after it is solved          (2)
 * so that lenses are solved on the whole picture, whose middle their axis is near.  What is not declared is refused: a
 * camera has pictures of one size, or, declared, of the whole picture unbinned, the whole one binned, the region. */
#ifndef CALIBRATE_MODES_H
#define CALIBRATE_MODES_H
#include "daemon/cli/calibrate/look.h"

/* "N" or "N,CAMERA"; "X,Y,W,H" or "X,Y,W,H,CAMERA"; without a camera: of all that have none of their own yet. */
PVX_MUST_CHECK pvx_err calibrate_mode_binning(struct calibrate_look *l, const char *text,
                                              struct pvx_diag *d);
PVX_MUST_CHECK pvx_err calibrate_mode_region(struct calibrate_look *l, const char *text,
                                             struct pvx_diag *d);

/* After the pictures were read: sizes of cameras, and the corners by (1).  PVX_EINVAL names the file and the camera. */
PVX_MUST_CHECK pvx_err calibrate_mode_sizes(struct calibrate_look *l, struct pvx_diag *d);
/* The cameras of a solved rig by (2), and those of an older one the other way. */
void calibrate_mode_crop(const struct calibrate_look *l, struct rec_rig *rig);
void calibrate_mode_uncrop(const struct calibrate_look *l, struct rec_rig *old);
#endif
