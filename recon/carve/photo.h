/* photo.h - photometry: binned linear pixels -> right-hand side b and silhouettes.
 *
 *     b = gain * (p - black - background),  lit = any channel of b >= threshold          (1)
 *
 * p is linear, 1.0 = the sensor's full scale.  NaN/Inf pixels become 0, weight 0, are counted and
 * count as lit (they carry no information, so they must not carve).  Saturated pixels (>= saturation) keep
 * their value, weight 0 and lit, and are counted.
 * Automatic threshold: the noise sigma is estimated per camera and channel from the darker half of the image, by
 * differences that are blind to slopes.  The threshold of a bin is max(floor, auto_k * sigma).  A dim picture has
 * the floor max(REC_PHOTO_DIMMEST, dim * its brightest bin), if that is less.  The threshold of a mean of 3x3 bins
 * is max(floor, auto_k * sigma / 3) above the level of the dark blocks.  If the lit bins' mean is less than 7.5
 * sigma, 7x7 bins are judged as well, at 1.25 auto_k sigma / 7: otherwise noise of 5 % of the peak and more would
 * carve the flame's outskirts away.  A uniform offset is NOT estimated, because it looks like an evenly lit image;
 * black and background are for that.
 * b beyond REC_PHOTO_LIMIT counts as not finite.
 * Blacks that are clipped at 0 keep the upper half of the dark's noise, light that was not there.  If `binning` is
 * known, it is found in the dark and taken out of b, and sigma is that of the whole noise (clipped.h).  Silhouettes are
 * judged before.  Pictures that are not clipped keep every bit.
 * despeckle removes lit bins with fewer than 2 lit neighbours of 8 (noise alone), when the
 * threshold is automatic; margin then grows the silhouette.
 * A mosaic (Bayer pixels as they are) has one channel per bin, that of its filter; the others are NaN in the
 * input and 0 in the output.  Its noise is estimated from differences between bins of the same colour.  A bin is
 * lit by its own sample, or by another channel as interpolated from its neighbours,
 *     plane = 4 K * b for red and blue, 2 K * b for green,  K = [1 2 1]'[1 2 1]/16            (2)
 * (red and blue: bilinear interpolation); 3x3 and 7x7 means are those of the plane, whose noise is
 * 0.5 and 0.255 sigma for red and blue, 0.354 and 0.18 sigma for green.
 * Where Bayer pixels were binned or interpolated, samples of red and blue count in more than one bin, so the
 * noise of neighbours is correlated.  It is estimated from differences over 2 bins (interpolated: 4), and
 *     sigma over that of n x n means = n^2 (8b - 6) / (8nb - 6)  for red and blue, n for green       (3)
 * b >= 2 the binning, by the weights 3 4 4 ... 1 of their samples along an axis; interpolated: about 1.5
 * and 2.9, green 2.2 and 4.4 for n = 3 and 7.
 * Threads: one call per work area; parallel inside over bands of rows, with the same result for any
 * number of threads and any instruction set.  Allocates nothing. */
#ifndef REC_PHOTO_H
#define REC_PHOTO_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "base/pool.h"

#ifdef __cplusplus
extern "C" {
#endif

#define REC_PHOTO_FULL        0.998f /* from here on a pixel is at full scale */
#define REC_PHOTO_UNSATURATED 1e30f
#define REC_PHOTO_LIMIT       1e9f /* more is not a measurement, and squares stay finite in float */
#define REC_PHOTO_DIMMEST     0.0005f /* of full scale: black levels are not known more precisely */

struct rec_photo_params {
    float black;      /* full-scale units, subtracted */
    float threshold;  /* full-scale units; < 0 = auto */
    float floor;      /* least automatic threshold, default 0.004 (1/255) */
    float dim;        /* share of the brightest bin that is enough as floor, default 0 = off */
    float auto_k;     /* default 4 */
    float saturation; /* < 0, the default = REC_PHOTO_FULL; REC_PHOTO_UNSATURATED = off */
    int32_t margin;   /* bins, >= 0, default 0: grows silhouettes for calibration error */
    int despeckle;    /* default 1 */
};
#define REC_PHOTO_DEFAULTS                                                                     \
    {                                                                                          \
        .black = 0, .threshold = -1, .floor = 0.004f, .dim = 0, .auto_k = 4, .saturation = -1, \
        .margin = 0, .despeckle = 1                                                            \
    }
extern const struct rec_photo_params rec_photo_defaults;

/* The `saturation` of a picture.  floats: floating-point numbers, which have no full scale.  value: that of its
 * saturated pixels, above all others (0: 1, full scale). */
static inline float rec_photo_saturation(const struct rec_photo_params *p, bool floats, float value)
{
    if (floats && p->saturation < 0)
        return REC_PHOTO_UNSATURATED;
    return value > 0 && p->saturation < REC_PHOTO_UNSATURATED ? 0.999f * value : p->saturation;
}

struct rec_photo_stats {
    uint32_t lit, saturated, not_finite;
    float sigma[3];  /* noise of b per channel, full-scale units */
    float threshold; /* used */
    float cut;       /* share of the dark's noise that is clipped at black; 0: none */
    float pedestal;  /* that the camera lacks for it, in units of a sample's full scale */
};

/* Work area of a picture of this size, free with free(); NULL: out of memory. */
struct rec_photo_work *rec_photo_work_new(int32_t bw, int32_t bh);

/* One camera's picture; cs = 4 for 3 channels, then img and background are 16-byte aligned. */
struct rec_photo_image {
    bool absent; /* no picture: img, weight and lit become 0 */
    float *img;  /* [bh][bw][cs] in: binned pixels, out: b */
    int32_t bw, bh;
    int nch;            /* 1 or 3 */
    int32_t binning;    /* a bin is the mean of so many pixels each way; 0: not known */
    uint32_t pictures;  /* a bin is the mean of so many pictures; 0: of one */
    const float *noise; /* [3] of one of them in the dark, per channel; 0: not known; or NULL */
    int32_t bayer; /* binning of channels made from Bayer pixels, 1 = interpolated; 0: others */
    const uint8_t *cell; /* a mosaic: colour (0 1 2) of each bin of the 2x2 bins that repeat, row by
                                row; nch 3, bw, bh >= 2; or NULL */
    const float *background; /* [bh][bw][cs] or NULL */
    const float *gain;       /* [3] */
    const struct rec_photo_params *params;
    float *weight;  /* [bh*bw] out: 0 or 1 */
    float *weight4; /* [bh*bw][4] out: of each channel, 16-byte aligned; or NULL */
    uint8_t *lit;   /* [bh*bw] out: 0/1 */
    struct rec_photo_stats *stats;
    struct rec_photo_work *work;
    float *plane; /* [bh*bw][4] work area of a mosaic, 16-byte aligned */
};
/* All cameras of a frame set, n <= REC_MAX_CAMERAS. */
void rec_photo_apply(const struct rec_photo_image *im, size_t n, pvx_pool *pool);

#ifdef __cplusplus
}
#endif
#endif
