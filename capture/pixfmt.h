/* pixfmt.h - raw pixels to linear binned float, in one pass over the raw bytes.
 *
 *     out[Y][X][ch] = mean over the finite samples of channel ch in bin (X,Y), / full scale     (1)
 * Bayer with binning >= 2: each colour's own samples, nothing interpolated; with binning 1:
 * bilinear demosaic.  nch = 1 from a colour image: mean of the three channels.  nch = 3 from grey:
 * the value in all three.  A bin in which any raw sample is saturated is reported as >= 1 (so that
 * the mean does not hide it); a bin without a finite sample is NaN.
 * Threads: pure; rows of bins [y0,y1) so that callers can split.  Bound: bytes read + written. */
#ifndef CAP_PIXFMT_H
#define CAP_PIXFMT_H
#include "base/err.h"
#include "capture/image.h"

/* img.width = bw*binning, img.height = bh*binning; out [bh][bw][cs], cs = 1 (nch 1) or 4 (nch 3,
 * 4th lane 0).  Errors: PVX_EINVAL (sizes), PVX_EUNSUP (format), PVX_EFORMAT (img.size too small
 * for stride*height). */
PVX_MUST_CHECK pvx_err cap_bin(const struct cap_image *img, int binning, int nch, int32_t y0,
                               int32_t y1, float *out);
#endif
