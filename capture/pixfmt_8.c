/* pixfmt_8.c - 8-bit linear samples.  Binning 2 and 4 first sum down the rows, byte by byte into 16
 * bits (a plain loop that vectorises), then across.  Saturation is found the same way: a byte that is
 * 255 in any row leaves a mark. */
#include <string.h>

#include "capture/pixfmt_priv.h"

/* ---- binning 1 ---- */

CAP_PIX_INLINE cap_f4 light4(cap_i4 v, cap_i4 lanes)
{
    cap_f4 one = {1, 1, 1, 1}, l = __builtin_convertvector(v, cap_f4) * (1.0f / 255.0f);
    cap_i4 full = v == 255;
    return (cap_f4)((((cap_i4)one & full) | ((cap_i4)l & ~full)) & lanes);
}

/* RGB pixels to 4 lanes; order 0 RGB, 2 BGR. */
CAP_PIX_INLINE void rgb_row(const uint8_t *p, int32_t w, int order, float *out)
{
    const cap_i4 lanes = {-1, -1, -1, 0};
    for (int32_t x = 0; x < w; x++, p += 3, out += 4)
        *(cap_f4 *)out = light4((cap_i4){p[order], p[1], p[2 - order], 0}, lanes);
}

static void grey_row(const uint8_t *p, int32_t w, int nch, float *restrict out)
{
    if (nch == 1) {
        for (int32_t x = 0; x < w; x++)
            out[x] = p[x] == 255 ? 1.0f : (float)p[x] * (1.0f / 255.0f);
        return;
    }
    const cap_i4 lanes = {-1, -1, -1, 0};
    for (int32_t x = 0; x < w; x++)
        *(cap_f4 *)(out + (size_t)x * 4) = light4((cap_i4){p[x], p[x], p[x], 0}, lanes);
}

static void mean_row(const struct cap_pix *j, const uint8_t *p, int32_t w, float *out)
{
    for (int32_t x = 0; x < w; x++, p += 3) {
        float rgb[3];
        bool saturated[3];
        for (int c = 0; c < 3; c++) {
            int v = p[j->swapped ? 2 - c : c];
            saturated[c] = v == 255;
            rgb[c] = (float)v * (1.0f / 255.0f);
        }
        cap_pix_put(out + x, rgb, saturated, false, 1);
    }
}

static void one_to_one(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    int32_t w = j->img.width;
    for (int32_t y = y0; y < y1; y++) {
        const uint8_t *row = (const uint8_t *)j->img.data + y * j->img.stride;
        float *o = out + (size_t)y * (size_t)w * (j->nch == 3 ? 4 : 1);
        if (j->grey)
            grey_row(row, w, j->nch, o);
        else if (j->nch == 1)
            mean_row(j, row, w, o);
        else if (j->swapped)
            rgb_row(row, w, 2, o);
        else
            rgb_row(row, w, 0, o);
    }
}

/* ---- binning 2 and 4 ---- */

enum { CHUNK = 1536 }; /* bytes of a row at a time; a multiple of 3*4 */

/* Sums of `rows` rows, `pitch` bytes apart, and marks. */
static void down(const uint8_t *p, ptrdiff_t pitch, int rows, size_t n, uint16_t *restrict sum,
                 uint8_t *restrict full)
{
    for (size_t i = 0; i < n; i++) {
        sum[i] = p[i];
        full[i] = p[i] == 255;
    }
    for (int r = 1; r < rows; r++) {
        const uint8_t *restrict q = p + r * pitch;
        for (size_t i = 0; i < n; i++) {
            sum[i] = (uint16_t)(sum[i] + q[i]);
            full[i] |= q[i] == 255;
        }
    }
}

/* Bins of an RGB (samples 3; order 2 = BGR) or grey (samples 1) row; b is a constant where this is inlined. */
CAP_PIX_INLINE void across(const uint16_t *sum, const uint8_t *full, int b, int samples, int order,
                           size_t bins, int nch, float *out)
{
    const float scale = 1.0f / ((float)(b * b) * 255.0f);
    for (size_t X = 0; X < bins; X++) {
        float rgb[3];
        bool saturated[3] = {false, false, false};
        for (int c = 0; c < samples; c++) {
            const size_t at = (size_t)(order != 0 ? order - c : c);
            unsigned s = 0, f = 0;
            for (int i = 0; i < b; i++) {
                s += sum[(X * (size_t)b + (size_t)i) * (size_t)samples + at];
                f |= full[(X * (size_t)b + (size_t)i) * (size_t)samples + at];
            }
            saturated[c] = f != 0;
            rgb[c] = f != 0 ? 1.0f : (float)s * scale;
        }
        cap_pix_put(out + X * (nch == 3 ? 4 : 1), rgb, saturated, samples == 1, nch);
    }
}

/* Bins of one row of bins, bytes [at, at+n) of its raw rows. */
static void bins_of(const struct cap_pix *j, const uint8_t *row, size_t n, float *out)
{
    uint16_t sum[CHUNK];
    uint8_t full[CHUNK];
    int b = j->binning, nch = j->nch;
    size_t bins = n / (size_t)(b * j->samples);
    down(row, j->img.stride, b, n, sum, full);
    if (j->swapped && b == 2)
        across(sum, full, 2, 3, 2, bins, nch, out);
    else if (j->swapped)
        across(sum, full, 4, 3, 2, bins, nch, out);
    else if (!j->grey && b == 2)
        across(sum, full, 2, 3, 0, bins, nch, out);
    else if (!j->grey)
        across(sum, full, 4, 3, 0, bins, nch, out);
    else if (b == 2)
        across(sum, full, 2, 1, 0, bins, nch, out);
    else
        across(sum, full, 4, 1, 0, bins, nch, out);
}

void cap_pix_8(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    if (j->binning == 1) {
        one_to_one(j, y0, y1, out);
        return;
    }
    size_t b = (size_t)j->binning, cs = j->nch == 3 ? 4 : 1;
    size_t row_bytes = (size_t)j->img.width * (size_t)j->samples;
    for (int32_t Y = y0; Y < y1; Y++) {
        const uint8_t *row =
            (const uint8_t *)j->img.data + (ptrdiff_t)Y * j->binning * j->img.stride;
        float *o = out + (size_t)Y * ((size_t)j->img.width / b) * cs;
        for (size_t at = 0; at < row_bytes; at += CHUNK)
            bins_of(j, row + at, row_bytes - at < CHUNK ? row_bytes - at : CHUNK,
                    o + at / (b * (size_t)j->samples) * cs);
    }
}
