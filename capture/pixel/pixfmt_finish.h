/* pixfmt_finish.h - sums to floats: scaled, 1 where saturated, channels side by side or their mean. */
#ifndef CAP_PIXFMT_FINISH_H
#define CAP_PIXFMT_FINISH_H
#include "capture/pixel/pixfmt_priv.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

/* Sums of light, < 2^31, and the greatest raw sample in each, per channel; a grey image uses the first.
 * Even and odd places may have different scales. */
struct cap_pix_bins {
    const uint32_t *sum[3];
    const uint16_t *top[3];
    float scale[3][2];
};
/* The maps' part for a piece.  Without maps: NULL.  `full`: value of what is saturated. */
struct piece {
    const uint32_t *word[3];
    float full;
    const float *matrix;
};

static struct piece pixel_piece_of(const struct cap_maps *m, size_t bin)
{
    const size_t more = m->p.nch == 3 ? m->plane : 0;
    const uint32_t *first = m->word + bin;
    return (struct piece){.word = {first, first + more, first + 2 * more},
                          .full = m->saturated,
                          .matrix = m->has_matrix ? m->matrix : NULL};
}

CAP_PIX_INLINE void grey(const struct cap_pix_bins *v, int32_t full, const struct piece *p,
                         bool mapped, int32_t n, float *restrict out)
{
    const uint32_t *restrict sum = v->sum[0], *restrict word = p->word[0];
    const uint16_t *restrict top = v->top[0];
    const float scale = v->scale[0][0], most = p->full;
    for (int32_t i = 0; i < n; i++) {
        float l = (float)(int32_t)sum[i] * scale;
        if (mapped)
            l = cap_pix_map(l, word[i]);
        out[i] = cap_pix_or(l, top[i] >= full, most);
    }
}

/* Three channels to their mean.  Even and odd places have their own scale (two = false: one scale for both). */
CAP_PIX_INLINE void mean(const struct cap_pix_bins *v, int32_t full, bool two,
                         const struct piece *p, bool mapped, int32_t n, float *restrict out)
{
    const uint32_t *r = v->sum[0], *g = v->sum[1], *b = v->sum[2];
    const uint16_t *rt = v->top[0], *gt = v->top[1], *bt = v->top[2];
    const uint32_t *restrict word = p->word[0];
    const float most = p->full;
    for (int32_t i = 0; i < n; i++) {
        const int k = two ? i & 1 : 0;
        float m = ((float)(int32_t)r[i] * v->scale[0][k] + (float)(int32_t)g[i] * v->scale[1][k] +
                   (float)(int32_t)b[i] * v->scale[2][k]) *
                  (1.0f / 3.0f);
        int32_t top = rt[i] > gt[i] ? rt[i] : gt[i];
        if (mapped)
            m = cap_pix_map(m, word[i]);
        out[i] = cap_pix_or(m, (bt[i] > top ? bt[i] : top) >= full, most);
    }
}

/* One row of the matrix times r, g, b, which may be vectors of any width.  A place that is saturated in one channel
 * becomes saturated in all three (coloured_eight, coloured_four). */
#define MATRIX_ROW(a, r, g, b) ((a)[0] * (r) + (a)[1] * (g) + (a)[2] * (b))

#if defined(__AVX2__)
CAP_PIX_INLINE __m256 eight(const uint32_t *sum, const uint16_t *top, __m256 scale, __m256i below,
                            const uint32_t *word, const struct piece *p)
{
    __m256 v = _mm256_mul_ps(_mm256_cvtepi32_ps(_mm256_loadu_si256((const __m256i *)sum)), scale);
    __m256i t = _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)top));
    if (word != NULL) { /* cap_pix_map */
        __m256i w = _mm256_loadu_si256((const __m256i *)word);
        __m256i factor = _mm256_and_si256(w, _mm256_set1_epi32(CAP_MAP_FACTOR));
        v = _mm256_mul_ps(_mm256_sub_ps(v, _mm256_castsi256_ps(w)), _mm256_cvtepi32_ps(factor));
    }
    return _mm256_blendv_ps(v, _mm256_set1_ps(p->full),
                            _mm256_castsi256_ps(_mm256_cmpgt_epi32(t, below)));
}

CAP_PIX_INLINE void coloured_eight(const float *a, float full, __m256 px[3])
{
    const __m256 top = _mm256_set1_ps(full), r = px[0], g = px[1], b = px[2];
    __m256 over =
        _mm256_or_ps(_mm256_cmp_ps(r, top, _CMP_EQ_OQ), _mm256_cmp_ps(g, top, _CMP_EQ_OQ));
    over = _mm256_or_ps(over, _mm256_cmp_ps(b, top, _CMP_EQ_OQ));
    for (int c = 0; c < 3; c++)
        px[c] = _mm256_blendv_ps(MATRIX_ROW(a + 3 * c, r, g, b), top, over);
}

/* Pixels 0, 4 | 1, 5 | 2, 6 | 3, 7, each in half a vector, to their places. */
CAP_PIX_INLINE void put_eight(__m256 r, __m256 g, __m256 b, float *out)
{
    const __m256 zero = _mm256_setzero_ps();
    __m256d rg0 = _mm256_castps_pd(_mm256_unpacklo_ps(r, g));
    __m256d rg2 = _mm256_castps_pd(_mm256_unpackhi_ps(r, g));
    __m256d b0 = _mm256_castps_pd(_mm256_unpacklo_ps(b, zero));
    __m256d b2 = _mm256_castps_pd(_mm256_unpackhi_ps(b, zero));
    __m256 p0 = _mm256_castpd_ps(_mm256_unpacklo_pd(rg0, b0));
    __m256 p1 = _mm256_castpd_ps(_mm256_unpackhi_pd(rg0, b0));
    __m256 p2 = _mm256_castpd_ps(_mm256_unpacklo_pd(rg2, b2));
    __m256 p3 = _mm256_castpd_ps(_mm256_unpackhi_pd(rg2, b2));
    _mm256_storeu_ps(out, _mm256_permute2f128_ps(p0, p1, 0x20));
    _mm256_storeu_ps(out + 8, _mm256_permute2f128_ps(p2, p3, 0x20));
    _mm256_storeu_ps(out + 16, _mm256_permute2f128_ps(p0, p1, 0x31));
    _mm256_storeu_ps(out + 24, _mm256_permute2f128_ps(p2, p3, 0x31));
}

/* As many as fit in groups of eight; returns how many. */
CAP_PIX_INLINE int32_t lanes_by_eight(const struct cap_pix_bins *v, unsigned full,
                                      const struct piece *p, bool mapped, bool coloured, int32_t n,
                                      float *out)
{
    const __m256i below = _mm256_set1_epi32((int)full - 1);
    __m256 scale[3], px[3];
    int32_t i = 0;
    for (int c = 0; c < 3; c++)
        scale[c] = _mm256_unpacklo_ps(_mm256_set1_ps(v->scale[c][0]), /* even, odd, even ... */
                                      _mm256_set1_ps(v->scale[c][1]));
    for (; i + 8 <= n; i += 8) {
        for (int c = 0; c < 3; c++)
            px[c] = eight(v->sum[c] + i, v->top[c] + i, scale[c], below,
                          mapped ? p->word[c] + i : NULL, p);
        if (coloured)
            coloured_eight(p->matrix, p->full, px);
        put_eight(px[0], px[1], px[2], out + (size_t)i * 4);
    }
    return i;
}
#endif

typedef uint16_t four16 __attribute__((vector_size(8), aligned(2), may_alias));

/* a where mask, else b. */
CAP_PIX_INLINE cap_f4 either(cap_i4 mask, cap_f4 a, cap_f4 b)
{
    return (cap_f4)(((cap_i4)a & mask) | ((cap_i4)b & ~mask));
}

CAP_PIX_INLINE cap_f4 mapped_four(cap_f4 v, cap_f4 word)
{
    return (v - word) * __builtin_convertvector((cap_i4)word & (int32_t)CAP_MAP_FACTOR, cap_f4);
}

CAP_PIX_INLINE cap_f4 finish_four(const uint32_t *sum, const uint16_t *top, cap_f4 scale,
                                  int32_t full, const uint32_t *word, const struct piece *p)
{
    const cap_f4 most = {p->full, p->full, p->full, p->full};
    cap_f4 v = __builtin_convertvector(*(const cap_i4 *)sum, cap_f4) * scale;
    cap_i4 over = __builtin_convertvector(*(const four16 *)top, cap_i4) >= full;
    if (word != NULL)
        v = mapped_four(v, *(const cap_f4 *)word);
    return either(over, most, v);
}

CAP_PIX_INLINE void coloured_four(const float *a, float full, cap_f4 px[3])
{
    const cap_f4 top = {full, full, full, full}, r = px[0], g = px[1], b = px[2];
    const cap_i4 over = (r == top) | (g == top) | (b == top);
    for (int c = 0; c < 3; c++)
        px[c] = either(over, top, MATRIX_ROW(a + 3 * c, r, g, b));
}

/* Four pixels' channels to lanes R G B 0, at most n of them written. */
CAP_PIX_INLINE void put_four(const cap_f4 c[3], int32_t n, float *out)
{
    const cap_f4 zero = {0};
    cap_f4 rg = __builtin_shufflevector(c[0], c[1], 0, 4, 1, 5),
           b0 = __builtin_shufflevector(c[2], zero, 0, 4, 1, 5);
    cap_f4 rg2 = __builtin_shufflevector(c[0], c[1], 2, 6, 3, 7),
           b2 = __builtin_shufflevector(c[2], zero, 2, 6, 3, 7);
    cap_f4 px[4] = {
        __builtin_shufflevector(rg, b0, 0, 1, 4, 5), __builtin_shufflevector(rg, b0, 2, 3, 6, 7),
        __builtin_shufflevector(rg2, b2, 0, 1, 4, 5), __builtin_shufflevector(rg2, b2, 2, 3, 6, 7)};
    for (int32_t k = 0; k < 4 && k < n; k++)
        *(cap_f4 *)(out + (size_t)k * 4) = px[k];
}

/* Three channels to lanes R G B 0. */
CAP_PIX_INLINE void lanes(const struct cap_pix_bins *v, unsigned full, const struct piece *p,
                          bool mapped, bool coloured, int32_t n, float *out)
{
    const struct cap_pix_bins bins = *v; /* copies, which `out` cannot alias */
    const struct piece here = *p;
    int32_t i = 0;
    cap_f4 scale[3], px[3];
    v = &bins;
    p = &here;
#if defined(__AVX2__)
    i = lanes_by_eight(v, full, p, mapped, coloured, n, out);
#endif
    for (int c = 0; c < 3; c++)
        scale[c] = (cap_f4){v->scale[c][0], v->scale[c][1], v->scale[c][0], v->scale[c][1]};
    for (; i < n; i += 4) { /* planes may be read beyond their end */
        for (int c = 0; c < 3; c++)
            px[c] = finish_four(v->sum[c] + i, v->top[c] + i, scale[c], (int32_t)full,
                                mapped ? p->word[c] + i : NULL, p);
        if (coloured)
            coloured_four(p->matrix, p->full, px);
        put_four(px, n - i, out + (size_t)i * 4);
    }
}

static void pixel_three(const struct cap_pix_bins *v, unsigned full, const struct piece *p,
                        int32_t n, float *out)
{
    if (p->matrix != NULL)
        lanes(v, full, p, true, true, n, out);
    else if (p->word[0] != NULL)
        lanes(v, full, p, true, false, n, out);
    else
        lanes(v, full, p, false, false, n, out);
}

static void pixel_one(const struct cap_pix_bins *v, bool is_grey, int32_t full,
                      const struct piece *p, int32_t n, float *out)
{
    const bool mapped = p->word[0] != NULL;
    if (is_grey && mapped)
        grey(v, full, p, true, n, out);
    else if (is_grey)
        grey(v, full, p, false, n, out);
    else if (mapped)
        mean(v, full, true, p, true, n, out);
    else if (v->scale[1][0] != v->scale[1][1]) /* if any channel has two scales, green has */
        mean(v, full, true, p, false, n, out);
    else
        mean(v, full, false, p, false, n, out);
}

/* n bins to floats, in the layout of cap_convert. */
static void pix_finish(const struct cap_pix *j, const struct cap_pix_bins *v, int32_t n, float *out)
{
    struct piece p = {.full = j->most};
    if (j->maps != NULL)
        p = pixel_piece_of(j->maps, (size_t)(out - j->base) / (j->nch == 3 ? 4 : 1));
    if (j->nch != 3) {
        pixel_one(v, j->grey, (int32_t)j->clip, &p, n, out);
        return;
    }
    if (!j->grey) {
        pixel_three(v, j->clip, &p, n, out);
        return;
    }
    const struct cap_pix_bins thrice = {
        {v->sum[0], v->sum[0], v->sum[0]},
        {v->top[0], v->top[0], v->top[0]},
        {{v->scale[0][0], v->scale[0][0]},
         {v->scale[0][0], v->scale[0][0]},
         {v->scale[0][0], v->scale[0][0]}},
    };
    pixel_three(&thrice, j->clip, &p, n, out);
}

CAP_PIX_INLINE void mapped_lane(cap_f4 word, const float *matrix, float unit, float *out)
{
    cap_f4 *px = (cap_f4 *)out, v = mapped_four(*px * unit, word);
    if (matrix == NULL)
        *px = v;
    for (int k = 0; k < 3 && matrix != NULL; k++)
        (*px)[k] = MATRIX_ROW(matrix + 3 * k, v[0], v[1], v[2]);
}

/* Maps for float images in lanes R G B 0. */
CAP_PIX_INLINE void mapped_lanes(const struct piece *p, const float *matrix, float unit, size_t n,
                                 float *out)
{
    cap_f4 c[3], word[4];
    size_t i = 0;
    for (; i < n; i += 4) { /* planes may be read beyond their end */
        for (int k = 0; k < 3; k++)
            c[k] = *(const cap_f4 *)(p->word[k] + i);
        put_four(c, 4, (float *)word);
        for (size_t k = 0; k < 4 && i + k < n; k++)
            mapped_lane(word[k], matrix, unit, out + (i + k) * 4);
    }
}

static void pix_mapped(const struct cap_pix *j, size_t at, size_t n, float *restrict out)
{
    const struct piece p = pixel_piece_of(j->maps, at);
    const uint32_t *restrict word = p.word[0];
    const float unit = j->unit;
    if (j->nch == 3 && p.matrix != NULL)
        mapped_lanes(&p, p.matrix, unit, n, out);
    else if (j->nch == 3)
        mapped_lanes(&p, NULL, unit, n, out);
    for (size_t i = 0; i < n && j->nch == 1; i++)
        out[i] = cap_pix_map(out[i] * unit, word[i]);
}
#endif
