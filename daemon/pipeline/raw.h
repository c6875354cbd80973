/* raw.h - a camera's image for a device that unpacks and bins it (recon/opencl/raw.h). */
#ifndef DMN_RAW_H
#define DMN_RAW_H
#include "capture/pixel/pixfmt.h"
#include "recon/opencl/raw.h"

/* What cap_convert(img, p) would make of it, for the device.  Borrows img's data, and p's maps.  false: cap_convert must
 * do it.  The image has floats, is a JPEG that is not decoded, or is not sound (cap_convert says why).  Or its maps leave
 * no bin without a masked pixel, or give numbers beyond REC_PHOTO_LIMIT. */
bool dmn_raw_of(const struct cap_image *img, const struct cap_convert_params *p,
                struct rec_cl_raw *out);

#endif
