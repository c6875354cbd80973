/* pixfmt_float.c - linear floats at binning 1: copied, but that what is not finite becomes NaN. */
#include <string.h>

#include "capture/pixfmt_priv.h"

CAP_PIX_INLINE float or_nan(const char *p)
{
    float v;
    memcpy(&v, p, sizeof v);
    return fabsf(v) < INFINITY ? v : NAN;
}

void cap_pix_floats(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    size_t n = (size_t)j->img.width;
    for (int32_t y = y0; y < y1; y++) {
        const char *row = (const char *)j->img.data + y * j->img.stride;
        float *o = out + (size_t)y * n * (j->grey ? 1 : 4);
        if (j->grey) {
            for (size_t x = 0; x < n; x++)
                o[x] = or_nan(row + x * 4);
            continue;
        }
        for (size_t x = 0; x < n; x++, row += 12, o += 4) {
            for (int c = 0; c < 3; c++)
                o[c] = or_nan(row + c * 4);
            o[3] = 0;
        }
    }
}
