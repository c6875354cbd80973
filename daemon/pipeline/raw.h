/* raw.h - a camera's image for a device that unpacks and bins it (recon/opencl/raw.h). */
#ifndef DMN_RAW_H
#define DMN_RAW_H
#include "capture/pixel/pixfmt.h"
#include "recon/opencl/raw.h"

/* What cap_convert(img, p) would make of it, for the device.  false: it must do that itself, because the image is
 * floats or a JPEG that is not decoded, or is not sound (cap_convert says why), or because each bin has a masked pixel in it, or its maps
 * give numbers beyond REC_PHOTO_LIMIT.  Borrows img's data, and p's maps. */
bool dmn_raw_of(const struct cap_image *img, const struct cap_convert_params *p,
                struct rec_cl_raw *out);

#endif
