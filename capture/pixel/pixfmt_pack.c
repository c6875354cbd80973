#include "capture/pixel/pixfmt_pack.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* `value` into `depth` bits from bit `at` on, least significant first.  These bits must be 0 before. */
static void put_bits(uint8_t *p, size_t at, int depth, unsigned value)
{
    for (int i = 0; i < depth; i++, at++)
        p[at / 8] = (uint8_t)(p[at / 8] | (value >> i & 1u) << at % 8);
}

static void put_sample(enum cap_pixfmt f, uint8_t *row, size_t i, unsigned v)
{
    int depth = cap_pixfmt_depth(f), low = depth - 8;
    uint16_t word = (uint16_t)v;
    unsigned rest = v & ((1u << low) - 1);
    switch (cap_pixfmt_layout(f)) {
    case CAP_LAYOUT_8: row[f == CAP_BGR8 ? i / 3 * 3 + 2 - i % 3 : i] = (uint8_t)v; break;
    case CAP_LAYOUT_16: memcpy(row + i * 2, &word, sizeof word); break;
    case CAP_LAYOUT_P: put_bits(row, i * (size_t)depth, depth, v); break;
    case CAP_LAYOUT_PACKED:
        row[i / 2 * 3 + i % 2 * 2] = (uint8_t)(v >> low);
        put_bits(row, (i / 2 * 3 + 1) * 8 + i % 2 * 4, low, rest);
        break;
    case CAP_LAYOUT_CSI:
        if (depth == 10) {
            row[i / 4 * 5 + i % 4] = (uint8_t)(v >> 2);
            put_bits(row, (i / 4 * 5 + 4) * 8 + i % 4 * 2, 2, rest);
        } else {
            row[i / 2 * 3 + i % 2] = (uint8_t)(v >> 4);
            put_bits(row, (i / 2 * 3 + 2) * 8 + i % 2 * 4, 4, rest);
        }
        break;
    default: break;
    }
}

/* Two pixels (both pointers may be the same pixel) to Y0, Y1, Cb, Cr. */
static void pair(const uint16_t *a, const uint16_t *b, uint8_t out[4])
{
    double y[2], cb = 0, cr = 0;
    for (int k = 0; k < 2; k++) {
        const uint16_t *p = k == 0 ? a : b;
        y[k] = (0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2]) / 255;
        cb += (p[2] / 255.0 - y[k]) / (2 * (1 - 0.114)) / 2;
        cr += (p[0] / 255.0 - y[k]) / (2 * (1 - 0.299)) / 2;
    }
    out[0] = (uint8_t)lrint(16 + 219 * y[0]);
    out[1] = (uint8_t)lrint(16 + 219 * y[1]);
    out[2] = (uint8_t)lrint(128 + 224 * cb);
    out[3] = (uint8_t)lrint(128 + 224 * cr);
}

static void pack_yuv(bool uyvy, int32_t width, const uint16_t *s, uint8_t *row)
{
    for (int32_t x = 0; x < width; x += 2, row += 4) {
        uint8_t q[4];
        pair(s + (size_t)x * 3, s + (size_t)(x + 1 < width ? x + 1 : x) * 3, q);
        row[uyvy] = q[0];
        row[2 + uyvy] = q[1];
        row[1 - uyvy] = q[2];
        row[3 - uyvy] = q[3];
    }
}

void cap_pixfmt_pack_row(enum cap_pixfmt f, int32_t width, const uint16_t *samples, void *row)
{
    enum cap_layout layout = cap_pixfmt_layout(f);
    if (layout == CAP_LAYOUT_YUV) {
        pack_yuv(f == CAP_UYVY, width, samples, row);
        return;
    }
    if (layout == CAP_LAYOUT_JPEG || layout == CAP_LAYOUT_F32)
        return;
    memset(row, 0, cap_pixfmt_row(f, width));
    size_t n = (size_t)width * (cap_pixfmt_bayer(f) != NULL ? 1 : (size_t)cap_pixfmt_channels(f));
    for (size_t i = 0; i < n; i++)
        put_sample(f, row, i, samples[i]);
}
