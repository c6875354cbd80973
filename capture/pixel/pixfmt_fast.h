/* pixfmt_fast.h - what the fast ways share: raw rows to planes of samples, sums of samples to floats.
 *
 * The files that include this are compiled twice, for any processor and (CAP_PIX_AVX2, see the Makefile)
 * for AVX2.  Most of them are plain loops that the compiler turns into vectors of either width; what it
 * would not is written out under CAP_PIX_AVX2.  Planes - one per channel, a Bayer image one in all - are
 * worked on a piece of a row at a time, which stays in the first-level cache with the table. */
#ifndef CAP_PIXFMT_FAST_H
#define CAP_PIXFMT_FAST_H
#include <string.h>

#include "capture/pixel/pixfmt_priv.h"

#if defined(CAP_PIX_AVX2)
#include <immintrin.h>
#define CAP_PIX(name) cap_pix_##name##_avx2
#else
#define CAP_PIX(name) cap_pix_##name##_plain
#endif

/* Samples behind a plane's end that may be written. */
enum { CAP_PIX_SLACK = 16 };

CAP_PIX_INLINE uint16_t cap_pix_greater(uint16_t a, uint16_t b)
{
    return a > b ? a : b;
}

/* n samples to what is added up: their light by the table, or (NULL) themselves. */
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

/* Raw samples of pixels [x, x+n) of row y, cut to full scale; channel c (0 R, 1 G, 2 B; of grey and Bayer
 * images the only one) at out + c*pitch.  x even, for 10 bits without gaps a multiple of 4. */
void CAP_PIX(row)(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, uint16_t *out,
                  size_t pitch);

/* Pixels x-1 .. x+n of one row of a Bayer image: what is added up, and the samples; x is at 1. */
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

/* n <= CAP_PIX_PIECE; the image goes on mirrored beyond its border, by one row or column. */
static inline void cap_pix_fetch(const struct cap_pix *j, int32_t y, int32_t x, int32_t n,
                                 struct cap_pix_line *restrict l)
{
    int32_t w = j->img.width, h = j->img.height;
    y = y < 0 ? -y : y >= h ? 2 * h - 2 - y : y;
    CAP_PIX(row)(j, y, x, n, l->top + 1, 0);
    cap_pix_light(l->top + 1, j->table, n, l->v + 1);
    cap_pix_fetch_one(j, x > 0 ? x - 1 : 1, y, 0, l);
    cap_pix_fetch_one(j, x + n < w ? x + n : w - 2, y, n + 1, l);
}

/* Sums of light, < 2^31, and the greatest raw sample in each, per channel; of a grey image the first.
 * Those at even and odd places may have scales of their own. */
struct cap_pix_bins {
    const uint32_t *sum[3];
    const uint16_t *top[3];
    float scale[3][2];
};
/* n of them to floats as cap_convert gives them. */
void CAP_PIX(finish)(const struct cap_pix *j, const struct cap_pix_bins *v, int32_t n, float *out);

void CAP_PIX(mapped)(const struct cap_pix *j, size_t at, size_t n, float *out);
void CAP_PIX(sums)(const struct cap_pix *j, int32_t y0, int32_t y1, float *out);
void CAP_PIX(bayer)(const struct cap_pix *j, int32_t y0, int32_t y1, float *out);
void CAP_PIX(mosaic)(const struct cap_pix *j, int32_t y0, int32_t y1, float *out);
#endif
