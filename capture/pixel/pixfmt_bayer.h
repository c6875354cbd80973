/* pixfmt_bayer.h - Bayer images at binning 1: bilinear interpolation, or each pixel as it is.
 *
 * A row's pixels alternate between the row's own colour (red or blue) and green.  At a pixel with
 *     h = left + right,  v = above + below,  x = the four diagonal ones
 * the missing colours are (h + v)/4 and x/4 at red and blue, h/2 and v/2 at green. */
#ifndef CAP_PIXFMT_BAYER_H
#define CAP_PIXFMT_BAYER_H
#include "capture/pixel/pixfmt_finish.h"
#include "capture/pixel/pixfmt_unpack.h"

enum { BAYER_ROOM = CAP_PIX_PIECE + CAP_PIX_SLACK };

/* Colour planes of a piece. */
struct planes {
    uint32_t sum[3][BAYER_ROOM];
    uint16_t top[3][BAYER_ROOM];
};

/* The row's own colour, green and the far colour at each pixel.  Green pixels are the odd places, or
 * (green_first) the even ones.  Separate restrict arguments for the rows let the compiler vectorise the loops.
 * NOLINTNEXTLINE(readability-function-size) */
CAP_PIX_INLINE void mix(const struct cap_pix_line *restrict up,
                        const struct cap_pix_line *restrict mid,
                        const struct cap_pix_line *restrict down, int32_t n, bool green_first,
                        uint32_t *restrict own, uint32_t *restrict green, uint32_t *restrict far)
{
    for (int32_t i = 0; i < n; i++) {
        const uint32_t is_green = 0u - ((uint32_t)(i + green_first) & 1u);
        uint32_t h = mid->v[i] + mid->v[i + 2], v = up->v[i + 1] + down->v[i + 1];
        uint32_t x = up->v[i] + up->v[i + 2] + down->v[i] + down->v[i + 2], at = mid->v[i + 1];
        own[i] = (h & is_green) | (at & ~is_green);
        far[i] = (v & is_green) | (x & ~is_green);
        green[i] = (at & is_green) | ((h + v) & ~is_green);
    }
}

/* As above.  NOLINTNEXTLINE(readability-function-size) */
CAP_PIX_INLINE void mix_tops(const struct cap_pix_line *restrict up,
                             const struct cap_pix_line *restrict mid,
                             const struct cap_pix_line *restrict down, int32_t n, bool green_first,
                             uint16_t *restrict own, uint16_t *restrict green,
                             uint16_t *restrict far)
{
    for (int32_t i = 0; i < n; i++) {
        const uint16_t is_green = (uint16_t)(0u - ((uint32_t)(i + green_first) & 1u));
        const uint16_t is_own = (uint16_t)~is_green;
        uint16_t h = cap_pix_greater(mid->top[i], mid->top[i + 2]);
        uint16_t v = cap_pix_greater(up->top[i + 1], down->top[i + 1]), at = mid->top[i + 1];
        uint16_t x = cap_pix_greater(cap_pix_greater(up->top[i], up->top[i + 2]),
                                     cap_pix_greater(down->top[i], down->top[i + 2]));
        own[i] = (uint16_t)((h & is_green) | (at & is_own));
        far[i] = (uint16_t)((v & is_green) | (x & is_own));
        green[i] = (uint16_t)((at & is_green) | (cap_pix_greater(h, v) & is_own));
    }
}

static void mix_row(const struct cap_pix *j, const struct cap_pix_line *up,
                    const struct cap_pix_line *mid, const struct cap_pix_line *down, int32_t n,
                    int32_t y, float *out)
{
    struct planes p;
    const uint8_t *c = j->cell + (y & 1) * 2;
    const bool green_first = c[0] == 1;
    const int own = green_first ? c[1] : c[0], far = 2 - own;
    const float one = cap_pix_scale(j, 1), two = cap_pix_scale(j, 2), four = cap_pix_scale(j, 4);
    struct cap_pix_bins v = {{p.sum[0], p.sum[1], p.sum[2]}, {p.top[0], p.top[1], p.top[2]}, {{0}}};
    mix(up, mid, down, n, green_first, p.sum[own], p.sum[1], p.sum[far]);
    mix_tops(up, mid, down, n, green_first, p.top[own], p.top[1], p.top[far]);
    v.scale[own][!green_first] = v.scale[far][!green_first] = two;
    v.scale[1][!green_first] = v.scale[own][green_first] = one;
    v.scale[1][green_first] = v.scale[far][green_first] = four;
    pix_finish(j, &v, n, out);
}

static void demosaic(const struct cap_pix *j, int32_t x, int32_t n, int32_t y0, int32_t y1,
                     float *out)
{
    struct cap_pix_line row[3]; /* above, at and below, in turn */
    int32_t w = j->img.width, h = j->img.height;
    cap_pix_fetch(j, y0 > 0 ? y0 - 1 : 1, x, n, &row[(y0 + 2) % 3]);
    cap_pix_fetch(j, y0, x, n, &row[y0 % 3]);
    for (int32_t y = y0; y < y1; y++) {
        cap_pix_fetch(j, y + 1 < h ? y + 1 : h - 2, x, n, &row[(y + 1) % 3]);
        mix_row(j, &row[(y + 2) % 3], &row[y % 3], &row[(y + 1) % 3], n, y,
                out + ((size_t)y * (size_t)w + (size_t)x) * (j->nch == 3 ? 4 : 1));
    }
}

#if defined(__AVX2__)
/* As many of n values as fit in groups of eight; returns how many.  Even places go to lane first, odd to second. */
static int32_t rays_by_eight(const float *light, int32_t n, int first, int second, float *out)
{
    const __m256i places = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1);
    float none[8] = {NAN, NAN, NAN, 0, NAN, NAN, NAN, 0};
    int32_t own[8] = {0}, i = 0;
    own[first] = own[4 + second] = -1;
    const __m256 rest = _mm256_loadu_ps(none);
    const __m256 mask = _mm256_castsi256_ps(_mm256_loadu_si256((const __m256i *)own));
    for (; i + 8 <= n; i += 8) {
        __m256 v = _mm256_loadu_ps(light + i);
        for (int k = 0; k < 4; k++) {
            __m256i at = _mm256_add_epi32(places, _mm256_set1_epi32(2 * k));
            _mm256_storeu_ps(out + (size_t)i * 4 + (size_t)k * 8,
                             _mm256_blendv_ps(rest, _mm256_permutevar8x32_ps(v, at), mask));
        }
    }
    return i;
}
#endif

/* NOLINTNEXTLINE(readability-function-size) */
CAP_PIX_INLINE void ray_light(const uint32_t *restrict v, const uint16_t *restrict s, int32_t full,
                              int32_t n, float scale, float top, const struct cap_maps *m,
                              const uint32_t *restrict word, float *restrict light)
{
    for (int32_t k = 0; k < n; k++) {
        float l = (float)(int32_t)v[k] * scale;
        if (m != NULL)
            l = cap_pix_map(l, word[k]);
        light[k] = cap_pix_or(l, s[k] >= full, top);
    }
}

/* Each pixel in the lane of its colour. */
static void rays(const struct cap_pix *j, int32_t x, int32_t n, int32_t y, float *out)
{
    uint16_t s[BAYER_ROOM];
    uint32_t v[CAP_PIX_PIECE];
    float light[CAP_PIX_PIECE];
    const float scale = cap_pix_scale(j, 1);
    const int32_t full = (int32_t)j->clip;
    const int first = j->cell[(y & 1) * 2], second = j->cell[(y & 1) * 2 + 1];
    const cap_f4 none = {NAN, NAN, NAN, 0};
    int32_t i = 0;
    pix_row(j, y, x, n, s, 0);
    cap_pix_light(s, j->table, n, v);
    if (j->maps != NULL)
        ray_light(v, s, full, n, scale, j->maps->saturated, j->maps,
                  j->maps->word + (size_t)y * (size_t)j->img.width + (size_t)x, light);
    else
        ray_light(v, s, full, n, scale, j->most, NULL, NULL, light);
#if defined(__AVX2__)
    i = rays_by_eight(light, n, first, second, out);
#endif
    for (; i < n; i++) {
        *(cap_f4 *)(out + (size_t)i * 4) = none;
        out[(size_t)i * 4 + (size_t)(i % 2 == 0 ? first : second)] = light[i];
    }
}

static void pix_bayer(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    int32_t w = j->img.width;
    if (!j->rays) {
        for (int32_t x = 0; x < w && y0 < y1; x += CAP_PIX_PIECE)
            demosaic(j, x, w - x < CAP_PIX_PIECE ? w - x : CAP_PIX_PIECE, y0, y1, out);
        return;
    }
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = 0; x < w; x += CAP_PIX_PIECE)
            rays(j, x, w - x < CAP_PIX_PIECE ? w - x : CAP_PIX_PIECE, y,
                 out + ((size_t)y * (size_t)w + (size_t)x) * 4);
}
#endif
