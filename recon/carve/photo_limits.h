/* photo_limits.h - what photometry decides from the noise of a picture, on whatever its loops run (photo.c,
 * recon/opencl/photo.c).  Private to recon. */
#ifndef REC_PHOTO_LIMITS_H
#define REC_PHOTO_LIMITS_H
#include "recon/carve/photo_pass.h"

#define REC_PHOTO_NOISY 7.5f /* mean of the lit bins over the noise: below it the flame is faint */

struct rec_grain rec_photo_grain(const struct rec_photo_image *im);
/* Thresholds of bins and means, from sigma, dark, clipped blacks and the bands' peaks. */
void rec_photo_set_limits(const struct rec_photo_image *im);
/* Whether blacks of any channel are clipped; false if the camera is absent. */
bool rec_photo_is_clipped(const struct rec_photo_image *im);
/* im->stats. */
void rec_photo_report(const struct rec_photo_image *im);

#endif
