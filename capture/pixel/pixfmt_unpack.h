/* pixfmt_unpack.h - raw rows to planes of 16-bit samples.
 *
 * Packed layouts: with AVX2, sixteen samples at a time by byte shuffles.  Otherwise four at a time, moved from one
 * 64-bit word into the quarters of another. */
#ifndef CAP_PIXFMT_UNPACK_H
#define CAP_PIXFMT_UNPACK_H
#include <string.h>

#include "capture/pixel/pixfmt_priv.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

/* Up to this many samples behind a plane's end may be written. */
enum { CAP_PIX_SLACK = 16 };

CAP_PIX_INLINE uint16_t cap_pix_greater(uint16_t a, uint16_t b)
{
    return a > b ? a : b;
}

/* n samples to the values that are summed: their light by the table, or (NULL) the samples themselves. */
static inline void cap_pix_light(const uint16_t *restrict s, const uint32_t *table, int32_t n,
                                 uint32_t *restrict light)
{
    if (table != NULL)
        for (int32_t i = 0; i < n; i++)
            light[i] = table[s[i]];
    else
        for (int32_t i = 0; i < n; i++)
            light[i] = s[i];
}

#if defined(__AVX2__)
/* Eight samples from 16 bytes:  (bytes `low` * times) >> (16 - depth) | bytes `high` << depth.
 * The product moves the wanted bits of a word to its top. */
struct spread {
    int8_t low[16], high[16]; /* index of a byte; -1 = a zero byte */
    uint16_t times[8];
    uint8_t depth, step; /* bits from `low`; bytes of eight samples */
};

#define TIMES2(a, b)                                                                   \
    {                                                                                  \
        1 << (a), 1 << (b), 1 << (a), 1 << (b), 1 << (a), 1 << (b), 1 << (a), 1 << (b) \
    }
#define TIMES4(a, b, c, d)                                                             \
    {                                                                                  \
        1 << (a), 1 << (b), 1 << (c), 1 << (d), 1 << (a), 1 << (b), 1 << (c), 1 << (d) \
    }
#define NO_HIGH                                                        \
    {                                                                  \
        -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1 \
    }

static const struct spread *pixel_spread_of(enum cap_layout layout, int depth)
{
    static const struct spread p[2] = {
        {{0, 1, 1, 2, 2, 3, 3, 4, 5, 6, 6, 7, 7, 8, 8, 9}, NO_HIGH, TIMES4(6, 4, 2, 0), 10, 10},
        {{0, 1, 1, 2, 3, 4, 4, 5, 6, 7, 7, 8, 9, 10, 10, 11}, NO_HIGH, TIMES2(4, 0), 12, 12}};
    static const struct spread packed[2] = {
        {{1, -1, 1, -1, 4, -1, 4, -1, 7, -1, 7, -1, 10, -1, 10, -1},
         {0, -1, 2, -1, 3, -1, 5, -1, 6, -1, 8, -1, 9, -1, 11, -1},
         TIMES2(14, 10),
         2,
         12},
        {{1, -1, 1, -1, 4, -1, 4, -1, 7, -1, 7, -1, 10, -1, 10, -1},
         {0, -1, 2, -1, 3, -1, 5, -1, 6, -1, 8, -1, 9, -1, 11, -1},
         TIMES2(12, 8),
         4,
         12}};
    static const struct spread csi[2] = {
        {{4, -1, 4, -1, 4, -1, 4, -1, 9, -1, 9, -1, 9, -1, 9, -1},
         {0, -1, 1, -1, 2, -1, 3, -1, 5, -1, 6, -1, 7, -1, 8, -1},
         TIMES4(14, 12, 10, 8),
         2,
         10},
        {{2, -1, 2, -1, 5, -1, 5, -1, 8, -1, 8, -1, 11, -1, 11, -1},
         {0, -1, 1, -1, 3, -1, 4, -1, 6, -1, 7, -1, 9, -1, 10, -1},
         TIMES2(12, 8),
         4,
         12}};
    const struct spread *pair = layout == CAP_LAYOUT_P        ? p
                                : layout == CAP_LAYOUT_PACKED ? packed
                                                              : csi;
    return &pair[depth == 12];
}

CAP_PIX_INLINE __m256i twice(const void *p, const void *q)
{
    return _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_loadu_si128((const __m128i *)p)),
                                   _mm_loadu_si128((const __m128i *)q), 1);
}

/* As many of n samples as fit in groups of sixteen without reading past `end`; returns how many. */
static int32_t sixteens(const uint8_t *p, const uint8_t *end, int32_t n, const struct spread *k,
                        uint16_t *out)
{
    const __m256i low = twice(k->low, k->low), high = twice(k->high, k->high);
    const __m256i times = twice(k->times, k->times);
    const __m128i down = _mm_cvtsi32_si128(16 - k->depth), up = _mm_cvtsi32_si128(k->depth);
    const int step = k->step;
    int32_t i = 0;
    for (; i + 16 <= n && end - p >= step + 16; i += 16, p += 2 * step) {
        __m256i v = twice(p, p + step);
        __m256i a = _mm256_mullo_epi16(_mm256_shuffle_epi8(v, low), times);
        __m256i b = _mm256_sll_epi16(_mm256_shuffle_epi8(v, high), up);
        _mm256_storeu_si256((__m256i *)(out + i), _mm256_or_si256(_mm256_srl_epi16(a, down), b));
    }
    return i;
}

/* As many of n RGB pixels as fit in groups of eight without reading past `end`; returns how many. */
static int32_t rgb_by_eight(const uint8_t *p, const uint8_t *end, int32_t n, uint16_t *r,
                            uint16_t *g, uint16_t *b)
{
    /* four pixels in each half: R and G as words, then B */
    const __m256i rg = _mm256_setr_epi8(0, -1, 3, -1, 6, -1, 9, -1, 1, -1, 4, -1, 7, -1, 10, -1, 0,
                                        -1, 3, -1, 6, -1, 9, -1, 1, -1, 4, -1, 7, -1, 10, -1);
    const __m256i bb =
        _mm256_setr_epi8(2, -1, 5, -1, 8, -1, 11, -1, -1, -1, -1, -1, -1, -1, -1, -1, 2, -1, 5, -1,
                         8, -1, 11, -1, -1, -1, -1, -1, -1, -1, -1, -1);
    int32_t i = 0;
    for (; i + 8 <= n && end - p >= 28; i += 8, p += 24) {
        __m256i v = twice(p, p + 12);
        __m256i q = _mm256_permute4x64_epi64(_mm256_shuffle_epi8(v, rg), 0xD8);
        __m256i s = _mm256_permute4x64_epi64(_mm256_shuffle_epi8(v, bb), 0xD8);
        _mm_storeu_si128((__m128i *)(r + i), _mm256_castsi256_si128(q));
        _mm_storeu_si128((__m128i *)(g + i), _mm256_extracti128_si256(q, 1));
        _mm_storeu_si128((__m128i *)(b + i), _mm256_castsi256_si128(s));
    }
    return i;
}
#else
static uint64_t pixel_load(const uint8_t *p)
{
    uint64_t w;
    memcpy(&w, p, sizeof w);
    return w;
}

/* The n bits of w from bit `lo` on, moved to bit `to`. */
#define BITS(w, lo, n, to)                                                                  \
    ((to) >= (lo)                                                                           \
         ? ((w) & ((((uint64_t)1 << (n)) - 1) << (lo))) << ((to) >= (lo) ? (to) - (lo) : 0) \
         : ((w) & ((((uint64_t)1 << (n)) - 1) << (lo))) >> ((to) < (lo) ? (lo) - (to) : 0))

/* The four samples at the start of w, each in 16 bits, the first lowest. */
CAP_PIX_INLINE uint64_t unpack_four(uint64_t w, enum cap_layout layout, int depth)
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

/* As many of n samples as can be read without reading past `end`; returns how many. */
CAP_PIX_INLINE int32_t fours(const uint8_t *p, const uint8_t *end, int32_t n,
                             enum cap_layout layout, int depth, uint16_t *out)
{
    const ptrdiff_t step = layout == CAP_LAYOUT_PACKED || depth == 12 ? 6 : 5;
    int32_t most = (int32_t)((end - p - 8) / step + 1) * 4, i;
    if (end - p < 8)
        return 0;
    for (i = 0; i + 4 <= n && i < most; i += 4, p += step) {
        uint64_t q = unpack_four(pixel_load(p), layout, depth);
        memcpy(out + i, &q, sizeof q);
    }
    return i;
}

static int32_t fours_of(const uint8_t *p, const uint8_t *end, int32_t n, enum cap_layout layout,
                        bool ten, uint16_t *out)
{
    switch (layout) {
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
#endif

/* As many of n packed samples as can be read without reading past `end`; returns how many. */
static int32_t groups_of(const struct cap_pix *j, const uint8_t *p, const uint8_t *end, int32_t n,
                         uint16_t *out)
{
    enum cap_layout layout = cap_pixfmt_layout(j->img.fmt);
    int depth = cap_pixfmt_depth(j->img.fmt);
#if defined(__AVX2__)
    return sixteens(p, end, n, pixel_spread_of(layout, depth), out);
#else
    return fours_of(p, end, n, layout, depth == 10, out);
#endif
}

/* The n packed samples at p, and up to 15 more of the row.  The last samples, whose whole group would reach
 * beyond `end`, are read from a copy. */
static void packed(const struct cap_pix *j, const uint8_t *p, const uint8_t *end, int32_t n,
                   uint16_t *out)
{
    uint8_t rest[96] = {0};
    int32_t done = groups_of(j, p, end, (n + 15) & ~15, out);
    if (done >= n)
        return;
    p += cap_pixfmt_row(j->img.fmt, done);
    memcpy(rest, p, (size_t)(end - p) < 48 ? (size_t)(end - p) : 48);
    groups_of(j, rest, rest + sizeof rest, (n - done + 15) & ~15, out + done);
}

static void rgb8(const uint8_t *p, const uint8_t *end, int32_t n, bool swapped, uint16_t *out,
                 size_t pitch)
{
    uint16_t *r = out + (swapped ? 2 * pitch : 0), *g = out + pitch;
    uint16_t *b = out + (swapped ? 0 : 2 * pitch);
    int32_t i = 0;
#if defined(__AVX2__)
    i = rgb_by_eight(p, end, (n + 7) & ~7, r, g, b);
#else
    (void)end;
#endif
    for (; i < n; i++) {
        r[i] = p[i * 3];
        g[i] = p[i * 3 + 1];
        b[i] = p[i * 3 + 2];
    }
}

static void rgb16(const uint8_t *p, int32_t n, unsigned full, uint16_t *out, size_t pitch)
{
    const uint16_t most = (uint16_t)full;
    for (int32_t i = 0; i < n; i++, p += 6)
        for (size_t c = 0; c < 3; c++) {
            uint16_t v;
            memcpy(&v, p + 2 * c, 2);
            out[c * pitch + (size_t)i] = v < most ? v : most;
        }
}

static void pixel_words(const uint8_t *p, int32_t n, unsigned full, uint16_t *restrict out)
{
    const uint16_t most = (uint16_t)full;
    memcpy(out, p, (size_t)n * 2);
    if (full < UINT16_MAX)
        for (int32_t i = 0; i < n; i++)
            out[i] = out[i] < most ? out[i] : most;
}

/* One channel of two pixels, as two 16-bit words: the value of cap_pix_yuv, clamped to 0..4095 as integers. */
CAP_PIX_INLINE uint32_t two_of(float y0, float y1, float chroma)
{
    int32_t a = (int32_t)(y0 + chroma), b = (int32_t)(y1 + chroma);
    a = a > 0 ? a : 0;
    b = b > 0 ? b : 0;
    return (uint32_t)(a < 4095 ? a : 4095) | (uint32_t)(b < 4095 ? b : 4095) << 16;
}

/* YUV pairs of pixels, each pair one 32-bit word.  In an odd row the last pixel is converted with its whole pair. */
CAP_PIX_INLINE void pairs(const struct cap_yuv_coef *coef, const uint8_t *restrict p, int32_t n,
                          bool uyvy, uint16_t *restrict out, size_t pitch)
{
    const struct cap_yuv_coef k = *coef; /* a copy that `out` cannot alias */
    const int luma = uyvy ? 8 : 0, chroma = 8 - luma;
    for (int32_t i = 0; i < (n + 1) / 2; i++) {
        uint32_t w, rgb[3];
        memcpy(&w, p + (size_t)i * 4, 4);
        float y0 = k.y[0] * (float)(int32_t)(w >> luma & 255);
        float y1 = k.y[0] * (float)(int32_t)(w >> (luma + 16) & 255);
        float cb = (float)(int32_t)(w >> chroma & 255);
        float cr = (float)(int32_t)(w >> (chroma + 16) & 255);
        rgb[0] = two_of(y0, y1, k.at0[0] + k.cr[0] * cr); /* the other coefficient is 0 */
        rgb[1] = two_of(y0, y1, k.at0[1] + (k.cb[1] * cb + k.cr[1] * cr));
        rgb[2] = two_of(y0, y1, k.at0[2] + k.cb[2] * cb);
        for (size_t c = 0; c < 3; c++)
            memcpy(out + c * pitch + (size_t)i * 2, &rgb[c], 4);
    }
}

/* Raw samples of pixels [x, x+n) of row y, clamped to full scale.  Channel c (0 R, 1 G, 2 B; grey and Bayer images
 * have one) is at out + c*pitch.  x must be even; for 10p and 10csi a multiple of 4. */
static void pix_row(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, uint16_t *out,
                    size_t pitch)
{
    const uint8_t *row = (const uint8_t *)j->img.data + y * j->img.stride;
    const uint8_t *p = row + cap_pixfmt_row(j->img.fmt, x);
    const uint8_t *end = row + cap_pixfmt_row(j->img.fmt, j->img.width);
    switch (cap_pixfmt_layout(j->img.fmt)) {
    case CAP_LAYOUT_8:
        if (j->samples == 3)
            rgb8(p, end, n, j->swapped, out, pitch);
        else
            for (int32_t i = 0; i < n; i++)
                out[i] = p[i];
        return;
    case CAP_LAYOUT_16:
        if (j->samples == 3)
            rgb16(p, n, j->full, out, pitch);
        else
            pixel_words(p, n, j->full, out);
        return;
    case CAP_LAYOUT_YUV:
        if (j->img.fmt == CAP_UYVY)
            pairs(&j->yuv, p, n, true, out, pitch);
        else
            pairs(&j->yuv, p, n, false, out, pitch);
        return;
    default: packed(j, p, end, n, out);
    }
}

/* Pixels x-1 .. x+n of one row of a Bayer image: the values that are summed, and the raw samples; x is at index 1. */
enum { CAP_PIX_PIECE = 512 }; /* pixels at a time, and one more on each side */
struct cap_pix_line {
    uint32_t v[CAP_PIX_PIECE + CAP_PIX_SLACK + 2];
    uint16_t top[CAP_PIX_PIECE + CAP_PIX_SLACK + 2];
};

static inline void cap_pix_fetch_one(const struct cap_pix *j, int32_t x, int32_t y, int32_t at,
                                     struct cap_pix_line *l)
{
    unsigned v = cap_pix_sample(j, x, y, 0);
    v = v < j->full ? v : j->full;
    l->top[at] = (uint16_t)v;
    l->v[at] = j->table == NULL ? v : j->table[v];
}

/* n <= CAP_PIX_PIECE.  Beyond its border the image is mirrored, by one row or column. */
static inline void cap_pix_fetch(const struct cap_pix *j, int32_t y, int32_t x, int32_t n,
                                 struct cap_pix_line *restrict l)
{
    int32_t w = j->img.width, h = j->img.height;
    y = y < 0 ? -y : y >= h ? 2 * h - 2 - y : y;
    pix_row(j, y, x, n, l->top + 1, 0);
    cap_pix_light(l->top + 1, j->table, n, l->v + 1);
    cap_pix_fetch_one(j, x > 0 ? x - 1 : 1, y, 0, l);
    cap_pix_fetch_one(j, x + n < w ? x + n : w - 2, y, n + 1, l);
}
#endif
