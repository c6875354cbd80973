/* look.h - from linear values to display values: exposure, tone curve, gamma.
 *
 *     sample = (2^depth - 1) T(f v)^(1/gamma)                                                     (1)
 *     clip      T(v) = min(v, 1)
 *     reinhard  T(v) = v (1 + L / w^2) / (1 + L), w = 4: colours stay what they are               (2)
 *     filmic    T(v) = v (2.51 v + 0.03) / (v (2.43 v + 0.59) + 0.14) of each channel: bright
 *               colours become white, as on film                                                  (3)
 * f exposure, v value, L luminance (ITU-R BT.709); T is cut at 0 and 1, NaN is dark.
 * Sources: (2) E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, Photographic tone reproduction for
 * digital images, SIGGRAPH 2002, eq. (4); (3) K. Narkowicz's fit of the ACES curve, 2016.
 * Threads: pure functions. */
#ifndef LOOK_H
#define LOOK_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

enum look_tone { LOOK_CLIP, LOOK_REINHARD, LOOK_FILMIC };

/* The range above 1 that a curve other than LOOK_CLIP shows.  The automatic exposure of a flame alone is longer by
 * this factor. */
#define LOOK_HEADROOM 4.0

struct look {
    double exposure; /* f; 0 = automatic, if the function allows it */
    double gamma;    /* 1: linear */
    enum look_tone tone;
    int depth; /* bits, 8 or 16 */
};
extern const struct look look_defaults; /* automatic, 2.2, clip, 8 */

/* Factor on an automatic exposure, for the tone curve of l. */
double look_headroom(const struct look *l);

/* Compute (1) for n pixels of nch channels (1 or 3) into samples, uint8_t or uint16_t [n][nch].  An exposure of 0
 * counts as 1. */
void look_samples(const struct look *l, const float *pix, size_t n, int nch, void *samples);

/* Compute (1) and save it as .png.  Errors: PVX_ENOMEM, the file's. */
PVX_MUST_CHECK pvx_err look_save(const struct look *l, const char *path, const float *pix,
                                 int32_t w, int32_t h, int nch, struct pvx_diag *d);

#endif
