/* pixfmt_float.c - linear floats.  At binning 1 they are copied, and values that are not finite become NaN.
 * Otherwise they are summed as doubles in row order, like the reference. */
#include <string.h>

#include "capture/pixel/pixfmt_priv.h"

CAP_PIX_INLINE float or_nan(const char *p)
{
    float v;
    memcpy(&v, p, sizeof v);
    return fabsf(v) < INFINITY ? v : NAN;
}

static void copied(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
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

/* Mean of the finite samples of one channel; p is the bin's first sample. */
CAP_PIX_INLINE float mean(const struct cap_pix *j, const char *p, int b, int samples)
{
    double sum = 0;
    int count = 0;
    for (int y = 0; y < b; y++, p += j->img.stride)
        for (int x = 0; x < b; x++) {
            float v;
            memcpy(&v, p + (size_t)x * (size_t)samples * sizeof v, sizeof v);
            bool finite = fabsf(v) < INFINITY;
            sum += finite ? (double)v : 0;
            count += finite;
        }
    return count == 0 ? NAN : (float)(sum / count);
}

CAP_PIX_INLINE void binned(const struct cap_pix *j, int b, int samples, int32_t y0, int32_t y1,
                           float *out)
{
    const bool saturated[3] = {false, false, false};
    const int32_t bw = j->img.width / b;
    for (int32_t Y = y0; Y < y1; Y++)
        for (int32_t X = 0; X < bw; X++) {
            const char *p = (const char *)j->img.data + (ptrdiff_t)Y * b * j->img.stride +
                            (size_t)(X * b * samples) * sizeof(float);
            float v[3] = {0};
            for (int c = 0; c < samples; c++)
                v[c] = mean(j, p + (size_t)c * sizeof(float), b, samples);
            cap_pix_put(out + ((size_t)Y * (size_t)bw + (size_t)X) * (j->nch == 3 ? 4 : 1), v,
                        saturated, 1, samples == 1, j->nch);
        }
}

void cap_pix_floats(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    if (j->binning == 1 && j->grey == (j->nch == 1))
        copied(j, y0, y1, out);
    else if (j->binning == 2 && j->grey)
        binned(j, 2, 1, y0, y1, out);
    else if (j->grey)
        binned(j, j->binning, 1, y0, y1, out);
    else if (j->binning == 2)
        binned(j, 2, 3, y0, y1, out);
    else
        binned(j, j->binning, 3, y0, y1, out);
}
