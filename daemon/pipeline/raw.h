/* raw.h - a camera's image for a device that unpacks and bins it (recon/opencl/raw.h). */
#ifndef DMN_RAW_H
#define DMN_RAW_H
#include "capture/pixel/pixfmt.h"
#include "recon/opencl/raw.h"

/* What cap_convert(img, p) would make of it, for the device.  false: it must do that itself, because the image is
 * gamma-coded, YUV, JPEG or floats, or has maps, or is not sound (cap_convert says why).  Borrows img's data. */
bool dmn_raw_of(const struct cap_image *img, const struct cap_convert_params *p,
                struct rec_cl_raw *out);

#endif
