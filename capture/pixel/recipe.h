/* recipe.h - what cap_convert does with the samples of an image, for those that do it elsewhere (a graphics card).
 *
 * Of integers and YUV.  Sample k of a YUV pixel is the whole part of
 *     min(max(y Y + (at_k + (cb_k Cb + cr_k Cr)), 0), 4095)                                          (0)
 * A sample v from `clip` on is saturated; else its light is table[v], without a table v itself.  A channel of a bin is
 *     m = (float)(sum of light) (1.0f / ((float)count full) unit)                                    (1)
 * over samples that are not masked, with the weights of pixfmt.h; `most` if one is saturated; NaN without any.  With
 * maps, for word k of the bin (maps.h),
 *     out = (m - k read as a float) (float)(k & CAP_RECIPE_FACTOR)                                   (2)
 * and with a matrix out_c = (M_c0 out_0 + M_c1 out_1) + M_c2 out_2, or `most` if any channel is saturated.
 * nch = 1 from three channels: m = (m_0 + m_1 + m_2) (1.0f / 3.0f), and `most` if any channel is saturated.
 * All operations are those of floats, each rounded, in this order: then the bits are cap_convert's. */
#ifndef CAP_RECIPE_H
#define CAP_RECIPE_H
#include "capture/pixel/pixfmt.h"

#define CAP_RECIPE_FACTOR 0x1FFFu

struct cap_recipe {      /* pointers are borrowed from the image's format, tables and maps */
    int samples, depth;  /* of a pixel, 1 or 3; bits, of YUV 12 */
    bool grey, swapped;  /* one channel; blue comes first */
    bool rays;           /* Bayer pixels as they are */
    const uint8_t *cell; /* Bayer: colours of the 2x2 pixels, row by row; or NULL */
    unsigned clip;
    float most;
    const uint32_t *table; /* [2^depth], at most CAP_LIGHT_ONE; or NULL */
    float full, unit;
    float y, cb[3], cr[3], at[3]; /* (0) */
    /* Number of the maps: no others in this process have it.  0: there are none, and the rest is NULL. */
    uint64_t maps;
    bool whole;           /* they have a bin in which no pixel is masked */
    const uint32_t *word; /* [planes][plane], a plane begins with those of the bins */
    size_t plane, planes; /* planes: 3, or 1 for all channels with nch = 1 or rays of binning 1 */
    /* A bit for each pixel, row by row, the least one first.  1: it is masked.  NULL: none is. */
    const uint8_t *mask;
    const float *matrix; /* [9] or NULL */
};
/* Errors: those of cap_convert; PVX_EUNSUP: floats, or a JPEG, which is decoded first. */
PVX_MUST_CHECK pvx_err cap_recipe_of(const struct cap_image *img,
                                     const struct cap_convert_params *p, struct cap_recipe *out);
#endif
