/* pixfmt.h - raw pixels to linear binned float, in one pass over the raw bytes.
 *
 *     out[Y][X][ch] = mean over the finite samples of channel ch in bin (X,Y), / full scale     (1)
 * Integer samples are summed as integers and scaled once: (float)sum * (1.0f / (count * full)).
 * Bayer with binning >= 2: each colour's own samples, nothing interpolated; with binning 1:
 * bilinear demosaic (mirrored at the border).  nch = 1 from a colour image: mean of the three
 * channels.  nch = 3 from grey: the value in all three.
 * A channel of a bin in which any raw sample is saturated (an integer at its full scale) is
 * reported as exactly 1, so that the mean does not hide it; with nch = 1 a saturated sample of any
 * channel counts.  Float samples have no saturation and are averaged as they are; a bin without a
 * finite sample is NaN.
 * Threads: pure; rows of bins [y0,y1) so that callers can split.  Bound: bytes read + written. */
#ifndef CAP_PIXFMT_H
#define CAP_PIXFMT_H
#include "base/err.h"
#include "capture/image.h"

#define CAP_BINNING_MAX 64

/* img.width = bw*binning, img.height = bh*binning; out [bh][bw][cs], cs = 1 (nch 1) or 4 (nch 3,
 * 4th lane 0).  Errors: PVX_EINVAL (sizes; a Bayer image less than 2 pixels wide or high),
 * PVX_EUNSUP (format), PVX_EFORMAT (img.size too small: stride*(height-1) + one row of pixels). */
PVX_MUST_CHECK pvx_err cap_bin(const struct cap_image *img, int binning, int nch, int32_t y0,
                               int32_t y1, float *out);
#endif
