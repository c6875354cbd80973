/* pixfmt.h - raw pixels to linear binned float, in one pass over the raw bytes.
 *
 *     out[Y][X][ch] = mean over the finite samples of channel ch in bin (X,Y), / full scale     (1)
 * Full scale is 2^depth - 1 (1023 for 10 bits).  Integer samples are summed as integers and scaled
 * once: (float)sum * (1.0f / (count * full)).  Each gamma-coded sample is first converted to light (transfer.h);
 * full is then CAP_LIGHT_ONE.
 * Bayer with binning >= 2: green is the mean of the bin's own green samples.  A red or blue sample stands for the
 * 2x2 pixels about it and counts as far as these lie in the bin (mirrored at the border).  With the bin's own
 * samples alone, red and blue would lie half a pixel beside the bin.
 * Bayer with binning 1: DEMOSAIC = bilinear (mirrored at the border).  RAYS = a pixel has only the channel that
 * its filter passes, and NaN in the two others; nch = 1 has no room for those, so RAYS is then DEMOSAIC.
 * nch = 1 from a colour image: mean of the three channels.  nch = 3 from grey: the value in all three.
 * A channel of a bin with any saturated raw sample (an integer at its full scale) is reported as exactly 1, so
 * that the mean does not hide the saturation.  With nch = 1 a saturated sample of any channel counts.
 * Words of 16 bits are saturated from CAP_CLIP_16 on: a sensor of 10, 12 or 14 bits in the upper bits ends there or
 * above.  `clip`: they are saturated from there on, and reported as cap_saturated: a sensor of fewer bits in the lower.
 * Words of 10, 12 and 14 bits in 16 must have upper bits 0 (PFNC, V4L2).  A word that does not, for instance from
 * a camera that aligns its samples to the left, has no usable value and counts as saturated.
 * Float samples have no saturation and are averaged as they are.  A bin without a finite sample is NaN.
 * YUV: with y = (Y - 16)/219, cb = (Cb - 128)/224, cr = (Cr - 128)/224 (full range: Y/255, /255),
 *     R' = y + 2(1-Kr) cr,  B' = y + 2(1-Kb) cb,  G' = y - 2Kb(1-Kb)/Kg cb - 2Kr(1-Kr)/Kg cr      (2)
 * Kr = 0.299, Kb = 0.114 (BT.601) or 0.2126, 0.0722 (BT.709), Kg = 1-Kr-Kb; R'G'B' clipped to 0..1 in
 * steps of 1/4095, 1 = saturated.  Both pixels of a pair have its Cb and Cr.
 * JPEG: jpeg.h decodes it to another format first.
 * With maps the camera's own response, dark, flat, gain and matrix are applied (maps.h).
 * Threads: pure; a call does rows of bins [y0,y1), so callers can split the work.  Bound: bytes read + written. */
#ifndef CAP_PIXFMT_H
#define CAP_PIXFMT_H
#include "base/err.h"
#include "capture/pixel/image.h"
#include "capture/pixel/transfer.h"

#define CAP_BINNING_MAX 64
#define CAP_CLIP_16     (1023 << 6)

struct cap_maps; /* maps.h */

enum cap_mosaic { CAP_MOSAIC_DEMOSAIC, CAP_MOSAIC_RAYS };

struct cap_convert_params {
    int binning, nch; /* 1..CAP_BINNING_MAX; 1 or 3 */
    enum cap_transfer transfer;
    enum cap_mosaic mosaic;      /* Bayer with binning 1 */
    const struct cap_maps *maps; /* made with the same params; or NULL */
    unsigned clip;               /* of words of 16 bits; 0 = CAP_CLIP_16 */
};

/* img.width = bw*binning, img.height = bh*binning; out [bh][bw][cs], cs = 1 (nch 1) or 4 (nch 3,
 * 4th float 0).  Errors: PVX_EINVAL (sizes; a Bayer image less than 2 pixels wide or high), PVX_EUNSUP (format;
 * maps for another format; a transfer other than linear for floats), PVX_EFORMAT (img.size less than
 * stride*(height-1) + one row of pixels). */
PVX_MUST_CHECK pvx_err cap_convert(const struct cap_image *img, const struct cap_convert_params *p,
                                   int32_t y0, int32_t y1, float *out);
/* The same with the transfer function that the image declares (AUTO), bilinear interpolation and no maps. */
PVX_MUST_CHECK pvx_err cap_bin(const struct cap_image *img, int binning, int nch, int32_t y0,
                               int32_t y1, float *out);
/* The transfer function that stands for AUTO. */
enum cap_transfer cap_transfer_declared(const struct cap_image *img);
/* The value of saturated channels; 1 without maps and clip. */
float cap_saturated(const struct cap_image *img, const struct cap_convert_params *p);
#endif
