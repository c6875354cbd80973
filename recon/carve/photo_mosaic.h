/* photo_mosaic.h - properties of mosaics for photo.c: bins that measure one channel each.
 * Private to photo*.c. */
#ifndef REC_PHOTO_MOSAIC_H
#define REC_PHOTO_MOSAIC_H
#include "recon/carve/photo.h"
#include "recon/simd/lanes.h"

/* Correlation of the noise of neighbouring bins. */
struct rec_grain {
    int32_t step;      /* distance in bins to the next bin with independent noise */
    rec_f4 near, wide; /* sigma over that of 3x3 and 7x7 means, per channel */
};
/* For independent bins; for a mosaic, equation (2) of photo.h; for bins made from Bayer pixels, equation (3). */
static const struct rec_grain rec_grain_none = {1, {3, 3, 3, 3}, {7, 7, 7, 7}};
static const struct rec_grain rec_grain_mosaic = {2, {2, 2.83f, 2, 1}, {3.92f, 5.55f, 3.92f, 1}};
struct rec_grain rec_grain_bayer(int32_t binning);

/* The lane that bin (x,y) measures. */
REC_INLINE rec_i4 rec_mosaic_lane(const uint8_t cell[4], int32_t x, int32_t y)
{
    static const rec_i4 lane[3] = {{-1, 0, 0, 0}, {0, -1, 0, 0}, {0, 0, -1, 0}};
    return lane[cell[(y & 1) * 2 + (x & 1)]];
}

#endif
