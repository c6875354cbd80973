/* pixfmt_unpack.c - raw rows to 16-bit samples.  Packed layouts: four samples at a time, moved from
 * one 64-bit word into the quarters of another; the end of a row, where a word would reach over its
 * last byte, sample by sample. */
#include <string.h>

#include "capture/pixfmt_priv.h"

static uint64_t load(const uint8_t *p)
{
    uint64_t w;
    memcpy(&w, p, sizeof w);
    return w;
}

/* a..b: bits lo..hi of w, moved up by `up` (0 when negative is not needed). */
#define BITS(w, lo, n, to)                                                                  \
    ((to) >= (lo)                                                                           \
         ? ((w) & ((((uint64_t)1 << (n)) - 1) << (lo))) << ((to) >= (lo) ? (to) - (lo) : 0) \
         : ((w) & ((((uint64_t)1 << (n)) - 1) << (lo))) >> ((to) < (lo) ? (lo) - (to) : 0))

/* The four samples at the start of w, each in 16 bits, the first lowest. */
CAP_PIX_INLINE uint64_t four(uint64_t w, enum cap_layout layout, int depth)
{
    if (layout == CAP_LAYOUT_P && depth == 10)
        return BITS(w, 0, 10, 0) | BITS(w, 10, 10, 16) | BITS(w, 20, 10, 32) | BITS(w, 30, 10, 48);
    if (layout == CAP_LAYOUT_P)
        return BITS(w, 0, 12, 0) | BITS(w, 12, 12, 16) | BITS(w, 24, 12, 32) | BITS(w, 36, 12, 48);
    if (layout == CAP_LAYOUT_PACKED && depth == 10)
        return BITS(w, 0, 8, 2) | BITS(w, 8, 2, 0) | BITS(w, 16, 8, 18) | BITS(w, 12, 2, 16) |
               BITS(w, 24, 8, 34) | BITS(w, 32, 2, 32) | BITS(w, 40, 8, 50) | BITS(w, 36, 2, 48);
    if (layout == CAP_LAYOUT_PACKED)
        return BITS(w, 0, 8, 4) | BITS(w, 8, 4, 0) | BITS(w, 16, 8, 20) | BITS(w, 12, 4, 16) |
               BITS(w, 24, 8, 36) | BITS(w, 32, 4, 32) | BITS(w, 40, 8, 52) | BITS(w, 36, 4, 48);
    if (depth == 10)
        return BITS(w, 0, 8, 2) | BITS(w, 32, 2, 0) | BITS(w, 8, 8, 18) | BITS(w, 34, 2, 16) |
               BITS(w, 16, 8, 34) | BITS(w, 36, 2, 32) | BITS(w, 24, 8, 50) | BITS(w, 38, 2, 48);
    return BITS(w, 0, 8, 4) | BITS(w, 16, 4, 0) | BITS(w, 8, 8, 20) | BITS(w, 20, 4, 16) |
           BITS(w, 24, 8, 36) | BITS(w, 40, 4, 32) | BITS(w, 32, 8, 52) | BITS(w, 44, 4, 48);
}

/* As many of n samples as can be taken without reading past `end`; returns how many. */
CAP_PIX_INLINE int32_t fours(const uint8_t *p, const uint8_t *end, int32_t n,
                             enum cap_layout layout, int depth, uint16_t *out)
{
    const ptrdiff_t step = layout == CAP_LAYOUT_PACKED || depth == 12 ? 6 : 5;
    int32_t most = (int32_t)((end - p - 8) / step + 1) * 4, i;
    if (end - p < 8)
        return 0;
    for (i = 0; i + 4 <= n && i < most; i += 4, p += step) {
        uint64_t q = four(load(p), layout, depth);
        memcpy(out + i, &q, sizeof q);
    }
    return i;
}

static int32_t packed(const struct cap_pix *j, const uint8_t *row, int32_t x, int32_t n,
                      uint16_t *out)
{
    enum cap_pixfmt f = j->img.fmt;
    const uint8_t *p = row + cap_pixfmt_row(f, x), *end = row + cap_pixfmt_row(f, j->img.width);
    bool ten = cap_pixfmt_depth(f) == 10;
    switch (cap_pixfmt_layout(f)) {
    case CAP_LAYOUT_P:
        return ten ? fours(p, end, n, CAP_LAYOUT_P, 10, out)
                   : fours(p, end, n, CAP_LAYOUT_P, 12, out);
    case CAP_LAYOUT_PACKED:
        return ten ? fours(p, end, n, CAP_LAYOUT_PACKED, 10, out)
                   : fours(p, end, n, CAP_LAYOUT_PACKED, 12, out);
    default:
        return ten ? fours(p, end, n, CAP_LAYOUT_CSI, 10, out)
                   : fours(p, end, n, CAP_LAYOUT_CSI, 12, out);
    }
}

CAP_PIX_INLINE void put3(cap_i4 rgb, uint16_t *out)
{
    out[0] = (uint16_t)rgb[0];
    out[1] = (uint16_t)rgb[1];
    out[2] = (uint16_t)rgb[2];
}

CAP_PIX_INLINE void pairs(const struct cap_yuv_coef *coef, const uint8_t *p, int32_t n, bool uyvy,
                          uint16_t *out)
{
    const struct cap_yuv_coef k = *coef; /* a copy that `out` cannot alias */
    for (int32_t i = 0; i < n; i += 2, p += 4, out += 6) {
        cap_f4 chroma = cap_pix_chroma(&k, p[1 - uyvy], p[3 - uyvy]);
        put3(cap_pix_yuv(&k, p[uyvy], chroma), out);
        if (i + 1 < n)
            put3(cap_pix_yuv(&k, p[2 + uyvy], chroma), out + 3);
    }
}

static void bytes(const struct cap_pix *j, const uint8_t *p, size_t n, uint16_t *restrict out)
{
    if (j->swapped)
        for (size_t i = 0; i + 3 <= n; i += 3) {
            out[i] = p[i + 2];
            out[i + 1] = p[i + 1];
            out[i + 2] = p[i];
        }
    else
        for (size_t i = 0; i < n; i++)
            out[i] = p[i];
}

void cap_pix_row(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, uint16_t *out)
{
    const uint8_t *row = (const uint8_t *)j->img.data + y * j->img.stride;
    size_t first = (size_t)x * (size_t)j->samples, count = (size_t)n * (size_t)j->samples;
    int32_t done;
    switch (cap_pixfmt_layout(j->img.fmt)) {
    case CAP_LAYOUT_8: bytes(j, row + first, count, out); return;
    case CAP_LAYOUT_16: memcpy(out, row + first * 2, count * 2); return;
    case CAP_LAYOUT_YUV:
        if (j->img.fmt == CAP_UYVY)
            pairs(&j->yuv, row + first / 3 * 2, n, true, out);
        else
            pairs(&j->yuv, row + first / 3 * 2, n, false, out);
        return;
    default: break;
    }
    done = packed(j, row, x, n, out);
    for (; done < n; done++)
        out[done] = (uint16_t)cap_pix_sample(j, x + done, y, 0);
}
