#include "capture/pixfmt.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* What one channel of one bin has gathered. */
struct gather {
    double sum;
    uint32_t count;
    bool saturated;
};

static float mean_of(const struct gather *g, float full)
{
    if (g->saturated)
        return 1;
    if (g->count == 0)
        return NAN;
    if (full > 0)
        return (float)g->sum * (1.0f / ((float)g->count * full));
    return (float)(g->sum / g->count);
}

/* Write one bin from its channel means; grey = the image has one channel. */
static void put_bin(float *out, const float rgb[3], const bool saturated[3], bool grey, int nch)
{
    if (nch == 3) {
        for (int c = 0; c < 3; c++)
            out[c] = grey ? rgb[0] : rgb[c];
        out[3] = 0;
    } else if (grey) {
        out[0] = rgb[0];
    } else if (saturated[0] || saturated[1] || saturated[2]) {
        out[0] = 1;
    } else {
        float sum = 0;
        int n = 0;
        for (int c = 0; c < 3; c++)
            if (isfinite(rgb[c])) {
                sum += rgb[c];
                n++;
            }
        out[0] = n == 3 ? sum * (1.0f / 3.0f) : n > 0 ? sum / (float)n : NAN;
    }
}

/* ---- any format, any binning: the readable way ------------------------------------------------ */

static float full_scale(enum cap_pixfmt f)
{
    switch (f) {
    case CAP_GREY16:
    case CAP_RGB16:
    case CAP_BAYER_RG16:
    case CAP_BAYER_GR16:
    case CAP_BAYER_GB16:
    case CAP_BAYER_BG16: return 65535;
    case CAP_GREY_F32:
    case CAP_RGB_F32: return 0; /* none: linear already */
    default: return 255;
    }
}

static void add_sample(struct gather *g, const uint8_t *p, float full)
{
    if (full == 255) {
        g->sum += *p;
        g->saturated |= *p == 255;
        g->count++;
    } else if (full > 0) {
        uint16_t v;
        memcpy(&v, p, sizeof v);
        g->sum += v;
        g->saturated |= v == 65535;
        g->count++;
    } else {
        float v;
        memcpy(&v, p, sizeof v);
        if (isfinite(v)) {
            g->sum += v;
            g->count++;
        }
    }
}

static void bin_any(const struct cap_image *img, int binning, int nch, int32_t y0, int32_t y1,
                    float *out)
{
    const uint8_t *cell = cap_pixfmt_bayer(img->fmt);
    bool grey = cap_pixfmt_channels(img->fmt) == 1;
    size_t bpp = cap_pixfmt_row(img->fmt, 1);
    int samples = cell != NULL || grey ? 1 : 3; /* per pixel */
    size_t sample_bytes = bpp / (size_t)samples;
    float full = full_scale(img->fmt);
    int32_t bw = img->width / binning;
    for (int32_t Y = y0; Y < y1; Y++)
        for (int32_t X = 0; X < bw; X++) {
            struct gather g[3] = {{0}};
            for (int32_t y = Y * binning; y < (Y + 1) * binning; y++) {
                const uint8_t *row = (const uint8_t *)img->data + y * img->stride;
                for (int32_t x = X * binning; x < (X + 1) * binning; x++)
                    for (int s = 0; s < samples; s++)
                        add_sample(&g[cell != NULL ? cell[(y & 1) * 2 + (x & 1)] : s],
                                   row + (size_t)x * bpp + (size_t)s * sample_bytes, full);
            }
            float rgb[3];
            bool saturated[3];
            for (int c = 0; c < 3; c++) {
                rgb[c] = mean_of(&g[c], full);
                saturated[c] = g[c].saturated;
            }
            put_bin(out + ((size_t)Y * (size_t)bw + (size_t)X) * (nch == 3 ? 4 : 1), rgb, saturated,
                    grey, nch);
        }
}

/* ---- 8 bit, binning 1 ------------------------------------------------------------------------- */

/* value[v] = v * (1/255), the same product as (1) with count 1. */
static void table8(float *value)
{
    for (int v = 0; v < 256; v++)
        value[v] = v == 255 ? 1.0f : (float)v * (1.0f / 255.0f);
}

static void rgb8_one(const uint8_t *p, const float *value, int nch, float *out)
{
    float rgb[3] = {value[p[0]], value[p[1]], value[p[2]]};
    bool saturated[3] = {p[0] == 255, p[1] == 255, p[2] == 255};
    put_bin(out, rgb, saturated, false, nch);
}

static void convert8(const struct cap_image *img, int nch, int32_t y0, int32_t y1, float *out)
{
    float value[256];
    table8(value);
    for (int32_t y = y0; y < y1; y++) {
        const uint8_t *row = (const uint8_t *)img->data + y * img->stride;
        float *o = out + (size_t)y * (size_t)img->width * (nch == 3 ? 4 : 1);
        for (int32_t x = 0; x < img->width; x++)
            if (img->fmt == CAP_RGB8)
                rgb8_one(row + (size_t)x * 3, value, nch, o + (size_t)x * (nch == 3 ? 4 : 1));
            else if (nch == 1)
                o[x] = value[row[x]];
            else
                put_bin(o + (size_t)x * 4, (float[3]){value[row[x]]}, NULL, true, 3);
    }
}

/* Bilinear demosaic: a pixel's own colour is its sample, the others are the mean of the nearest
 * samples of that colour (2 beside or above and below, or 4 around). */
static void demosaic8(const struct cap_image *img, int nch, int32_t y0, int32_t y1, float *out)
{
    const uint8_t *cell = cap_pixfmt_bayer(img->fmt);
    int32_t w = img->width, h = img->height;
    for (int32_t y = y0; y < y1; y++) {
        const uint8_t *base = img->data;
        const uint8_t *mid = base + y * img->stride;
        const uint8_t *up = base + (y > 0 ? y - 1 : 1) * img->stride;
        const uint8_t *down = base + (y + 1 < h ? y + 1 : h - 2) * img->stride;
        for (int32_t x = 0; x < w; x++) {
            int32_t l = x > 0 ? x - 1 : 1, r = x + 1 < w ? x + 1 : w - 2;
            int own = cell[(y & 1) * 2 + (x & 1)], beside = cell[(y & 1) * 2 + (~x & 1)];
            unsigned sum[3] = {0};
            float count[3] = {1, 1, 1};
            bool full[3] = {false, false, false};
            sum[own] = mid[x];
            full[own] = mid[x] == 255;
            if (own == 1) { /* green: one colour beside, the other above and below */
                int above = 2 - beside;
                sum[beside] = (unsigned)mid[l] + mid[r];
                full[beside] = mid[l] == 255 || mid[r] == 255;
                sum[above] = (unsigned)up[x] + down[x];
                full[above] = up[x] == 255 || down[x] == 255;
                count[beside] = count[above] = 2;
            } else {
                int far = 2 - own;
                sum[1] = (unsigned)mid[l] + mid[r] + up[x] + down[x];
                full[1] = mid[l] == 255 || mid[r] == 255 || up[x] == 255 || down[x] == 255;
                sum[far] = (unsigned)up[l] + up[r] + down[l] + down[r];
                full[far] = up[l] == 255 || up[r] == 255 || down[l] == 255 || down[r] == 255;
                count[1] = count[far] = 4;
            }
            float rgb[3];
            for (int c = 0; c < 3; c++)
                rgb[c] = full[c] ? 1.0f : (float)sum[c] * (1.0f / (count[c] * 255.0f));
            put_bin(out + ((size_t)y * (size_t)w + (size_t)x) * (nch == 3 ? 4 : 1), rgb, full,
                    false, nch);
        }
    }
}

/* ---- 8 bit, binning 2 and 4 -------------------------------------------------------------------
 * First down the rows, byte by byte into 16 bits (a plain loop that vectorises), then across.
 * Saturation is found the same way: a byte that is 255 in any row leaves a mark in `full`. */

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

/* Bins of an RGB8 (samples 3) or Mono8 (samples 1) row; b is a constant where this is inlined. */
static inline __attribute__((always_inline)) void across(const uint16_t *sum, const uint8_t *full,
                                                         int b, int samples, size_t bins, int nch,
                                                         float *out)
{
    const float scale = 1.0f / ((float)(b * b) * 255.0f);
    for (size_t X = 0; X < bins; X++) {
        float rgb[3];
        bool saturated[3] = {false, false, false};
        for (int c = 0; c < samples; c++) {
            unsigned s = 0, f = 0;
            for (int i = 0; i < b; i++) {
                s += sum[(X * (size_t)b + (size_t)i) * (size_t)samples + (size_t)c];
                f |= full[(X * (size_t)b + (size_t)i) * (size_t)samples + (size_t)c];
            }
            saturated[c] = f != 0;
            rgb[c] = f != 0 ? 1.0f : (float)s * scale;
        }
        put_bin(out + X * (nch == 3 ? 4 : 1), rgb, saturated, samples == 1, nch);
    }
}

/* Bins of a Bayer row from the sums of its even and odd raw rows. */
static inline __attribute__((always_inline)) void across_bayer(const uint16_t *const sum[2],
                                                               const uint8_t *const full[2],
                                                               const uint8_t *cell, int b,
                                                               size_t bins, int nch, float *out)
{
    const float one = 1.0f / ((float)(b * b / 4) * 255.0f); /* red, blue */
    const float green = 1.0f / ((float)(b * b / 2) * 255.0f);
    /* places of red and blue in the 2x2 cell; blue lies across from red */
    const int red = cell[0] == 0 ? 0 : cell[1] == 0 ? 1 : cell[2] == 0 ? 2 : 3, blue = 3 - red;
    const int g1 = red == 0 || red == 3 ? 1 : 0, g2 = 3 - g1;
    for (size_t X = 0; X < bins; X++) {
        unsigned q[4] = {0}, m[4] = {0}; /* by place in the cell */
        for (int k = 0; k < 4; k++)
            for (int i = k & 1; i < b; i += 2) {
                q[k] += sum[k >> 1][X * (size_t)b + (size_t)i];
                m[k] |= full[k >> 1][X * (size_t)b + (size_t)i];
            }
        const unsigned s[3] = {q[red], q[g1] + q[g2], q[blue]};
        const unsigned f[3] = {m[red], m[g1] | m[g2], m[blue]};
        float rgb[3];
        bool saturated[3];
        for (int c = 0; c < 3; c++) {
            saturated[c] = f[c] != 0;
            rgb[c] = f[c] != 0 ? 1.0f : (float)s[c] * (c == 1 ? green : one);
        }
        put_bin(out + X * (nch == 3 ? 4 : 1), rgb, saturated, false, nch);
    }
}

static void bin8(const struct cap_image *img, int b, int nch, int32_t y0, int32_t y1, float *out)
{
    const uint8_t *cell = cap_pixfmt_bayer(img->fmt);
    int samples = img->fmt == CAP_RGB8 ? 3 : 1;
    size_t row_bytes = (size_t)img->width * (size_t)samples;
    size_t bin_bytes = (size_t)(b * samples), cs = nch == 3 ? 4 : 1;
    uint16_t sum[2][CHUNK];
    uint8_t full[2][CHUNK];
    for (int32_t Y = y0; Y < y1; Y++) {
        const uint8_t *row = (const uint8_t *)img->data + (ptrdiff_t)Y * b * img->stride;
        float *o = out + (size_t)Y * (size_t)(img->width / b) * cs;
        for (size_t at = 0; at < row_bytes; at += CHUNK) {
            size_t n = row_bytes - at < CHUNK ? row_bytes - at : CHUNK, bins = n / bin_bytes;
            float *dst = o + at / bin_bytes * cs;
            if (cell != NULL) {
                down(row + at, 2 * img->stride, b / 2, n, sum[0], full[0]);
                down(row + at + img->stride, 2 * img->stride, b / 2, n, sum[1], full[1]);
                const uint16_t *const s[2] = {sum[0], sum[1]};
                const uint8_t *const f[2] = {full[0], full[1]};
                if (b == 2)
                    across_bayer(s, f, cell, 2, bins, nch, dst);
                else
                    across_bayer(s, f, cell, 4, bins, nch, dst);
                continue;
            }
            down(row + at, img->stride, b, n, sum[0], full[0]);
            if (samples == 3 && b == 2)
                across(sum[0], full[0], 2, 3, bins, nch, dst);
            else if (samples == 3)
                across(sum[0], full[0], 4, 3, bins, nch, dst);
            else if (b == 2)
                across(sum[0], full[0], 2, 1, bins, nch, dst);
            else
                across(sum[0], full[0], 4, 1, bins, nch, dst);
        }
    }
}

pvx_err cap_bin(const struct cap_image *img, int binning, int nch, int32_t y0, int32_t y1,
                float *out)
{
    size_t bpp = cap_pixfmt_row(img->fmt, 1);
    enum cap_layout layout = cap_pixfmt_layout(img->fmt);
    if ((layout != CAP_LAYOUT_8 || img->fmt == CAP_BGR8) && layout != CAP_LAYOUT_F32 &&
        !(layout == CAP_LAYOUT_16 && cap_pixfmt_depth(img->fmt) == 16))
        return PVX_EUNSUP;
    bool bayer = cap_pixfmt_bayer(img->fmt) != NULL;
    if (binning < 1 || binning > CAP_BINNING_MAX || (nch != 1 && nch != 3) || img->width < 1 ||
        img->height < 1 || img->width % binning != 0 || img->height % binning != 0 || y0 < 0 ||
        y1 > img->height / binning || (bayer && (img->width < 2 || img->height < 2)))
        return PVX_EINVAL;
    size_t row = (size_t)img->width * bpp;
    if (img->stride < 0 || (size_t)img->stride < row)
        return PVX_EINVAL;
    size_t need;
    if (__builtin_mul_overflow((size_t)img->stride, (size_t)(img->height - 1), &need) ||
        __builtin_add_overflow(need, row, &need) || img->data == NULL || img->size < need)
        return PVX_EFORMAT;
    if (full_scale(img->fmt) != 255)
        bin_any(img, binning, nch, y0, y1, out);
    else if (binning == 1 && bayer)
        demosaic8(img, nch, y0, y1, out);
    else if (binning == 1)
        convert8(img, nch, y0, y1, out);
    else if (binning == 2 || binning == 4)
        bin8(img, binning, nch, y0, y1, out);
    else
        bin_any(img, binning, nch, y0, y1, out);
    return PVX_OK;
}
