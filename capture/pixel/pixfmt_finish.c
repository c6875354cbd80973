/* pixfmt_finish.c - sums to floats: scaled, 1 where saturated, channels side by side or their mean. */
#include "capture/pixel/pixfmt_fast.h"

static void grey(const uint32_t *restrict sum, const uint16_t *restrict top, int32_t full,
                 float scale, int32_t n, float *restrict out)
{
    for (int32_t i = 0; i < n; i++)
        out[i] = cap_pix_value((float)(int32_t)sum[i] * scale, top[i] >= full);
}

/* Three channels to their mean; the scale is that of the place's parity (two = false: there is one). */
CAP_PIX_INLINE void mean(const struct cap_pix_bins *v, int32_t full, bool two, int32_t n,
                         float *restrict out)
{
    const uint32_t *r = v->sum[0], *g = v->sum[1], *b = v->sum[2];
    const uint16_t *rt = v->top[0], *gt = v->top[1], *bt = v->top[2];
    for (int32_t i = 0; i < n; i++) {
        const int k = two ? i & 1 : 0;
        float m = ((float)(int32_t)r[i] * v->scale[0][k] + (float)(int32_t)g[i] * v->scale[1][k] +
                   (float)(int32_t)b[i] * v->scale[2][k]) *
                  (1.0f / 3.0f);
        int32_t top = rt[i] > gt[i] ? rt[i] : gt[i];
        out[i] = cap_pix_value(m, (bt[i] > top ? bt[i] : top) >= full);
    }
}

#if defined(CAP_PIX_AVX2)
CAP_PIX_INLINE __m256 eight(const uint32_t *sum, const uint16_t *top, __m256 scale, __m256i below)
{
    __m256 v = _mm256_cvtepi32_ps(_mm256_loadu_si256((const __m256i *)sum));
    __m256i t = _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)top));
    return _mm256_blendv_ps(_mm256_mul_ps(v, scale), _mm256_set1_ps(1.0f),
                            _mm256_castsi256_ps(_mm256_cmpgt_epi32(t, below)));
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

/* As many as come in eights. */
static int32_t lanes_by_eight(const struct cap_pix_bins *v, unsigned full, int32_t n, float *out)
{
    const __m256i below = _mm256_set1_epi32((int)full - 1);
    __m256 scale[3];
    int32_t i = 0;
    for (int c = 0; c < 3; c++)
        scale[c] = _mm256_unpacklo_ps(_mm256_set1_ps(v->scale[c][0]), /* even, odd, even ... */
                                      _mm256_set1_ps(v->scale[c][1]));
    for (; i + 8 <= n; i += 8)
        put_eight(eight(v->sum[0] + i, v->top[0] + i, scale[0], below),
                  eight(v->sum[1] + i, v->top[1] + i, scale[1], below),
                  eight(v->sum[2] + i, v->top[2] + i, scale[2], below), out + (size_t)i * 4);
    return i;
}
#endif

typedef uint16_t four16 __attribute__((vector_size(8), aligned(2), may_alias));

CAP_PIX_INLINE cap_f4 four(const uint32_t *sum, const uint16_t *top, cap_f4 scale, int32_t full)
{
    const cap_f4 one = {1, 1, 1, 1};
    cap_f4 v = __builtin_convertvector(*(const cap_i4 *)sum, cap_f4) * scale;
    cap_i4 bad = __builtin_convertvector(*(const four16 *)top, cap_i4) >= full;
    return (cap_f4)(((cap_i4)one & bad) | ((cap_i4)v & ~bad));
}

/* Three channels to lanes R G B 0. */
static void lanes(const struct cap_pix_bins *v, unsigned full, int32_t n, float *out)
{
    int32_t i = 0;
    cap_f4 scale[3];
#if defined(CAP_PIX_AVX2)
    i = lanes_by_eight(v, full, n, out);
#endif
    for (int c = 0; c < 3; c++)
        scale[c] = (cap_f4){v->scale[c][0], v->scale[c][1], v->scale[c][0], v->scale[c][1]};
    for (; i < n; i += 4) { /* planes may be read beyond their end */
        cap_f4 r = four(v->sum[0] + i, v->top[0] + i, scale[0], (int32_t)full);
        cap_f4 g = four(v->sum[1] + i, v->top[1] + i, scale[1], (int32_t)full);
        cap_f4 b = four(v->sum[2] + i, v->top[2] + i, scale[2], (int32_t)full), zero = {0};
        cap_f4 rg = __builtin_shufflevector(r, g, 0, 4, 1, 5),
               b0 = __builtin_shufflevector(b, zero, 0, 4, 1, 5);
        cap_f4 rg2 = __builtin_shufflevector(r, g, 2, 6, 3, 7),
               b2 = __builtin_shufflevector(b, zero, 2, 6, 3, 7);
        cap_f4 px[4] = {__builtin_shufflevector(rg, b0, 0, 1, 4, 5),
                        __builtin_shufflevector(rg, b0, 2, 3, 6, 7),
                        __builtin_shufflevector(rg2, b2, 0, 1, 4, 5),
                        __builtin_shufflevector(rg2, b2, 2, 3, 6, 7)};
        for (int32_t k = 0; k < 4 && i + k < n; k++)
            *(cap_f4 *)(out + (size_t)(i + k) * 4) = px[k];
    }
}

static void colours(const struct cap_maps *m, size_t n, float *v)
{
    const float *a = m->matrix, top = m->saturated;
    for (size_t i = 0; i < n; i += 4) {
        const float r = v[i], g = v[i + 1], b = v[i + 2];
        const bool full = r == top || g == top || b == top;
        v[i] = cap_pix_map_full(a[0] * r + a[1] * g + a[2] * b, full, top);
        v[i + 1] = cap_pix_map_full(a[3] * r + a[4] * g + a[5] * b, full, top);
        v[i + 2] = cap_pix_map_full(a[6] * r + a[7] * g + a[8] * b, full, top);
    }
}

void CAP_PIX(mapped)(const struct cap_pix *j, size_t at, size_t n, float *restrict v)
{
    const struct cap_maps *m = j->maps;
    const int16_t *restrict dark = m->dark + at;
    const uint16_t *restrict factor = m->factor + at;
    const float dark_step = m->dark_step, step = m->factor_step, top = m->saturated;
    const float full = j->full > 0 ? 1 : INFINITY; /* floats do not saturate */
    for (size_t i = 0; i < n; i++)
        v[i] = cap_pix_map_full((v[i] - (float)dark[i] * dark_step) * ((float)factor[i] * step),
                                v[i] == full, top);
    if (m->has_matrix)
        colours(m, n, v);
}

static void converted(const struct cap_pix *j, const struct cap_pix_bins *v, int32_t n, float *out)
{
    bool two = false;
    if (j->grey && j->nch == 1) {
        grey(v->sum[0], v->top[0], (int32_t)j->full, v->scale[0][0], n, out);
        return;
    }
    if (j->grey) {
        const struct cap_pix_bins thrice = {
            {v->sum[0], v->sum[0], v->sum[0]},
            {v->top[0], v->top[0], v->top[0]},
            {{v->scale[0][0], v->scale[0][0]},
             {v->scale[0][0], v->scale[0][0]},
             {v->scale[0][0], v->scale[0][0]}},
        };
        lanes(&thrice, j->full, n, out);
        return;
    }
    for (int c = 0; c < 3; c++)
        two |= v->scale[c][0] != v->scale[c][1];
    if (j->nch == 3)
        lanes(v, j->full, n, out);
    else if (two)
        mean(v, (int32_t)j->full, true, n, out);
    else
        mean(v, (int32_t)j->full, false, n, out);
}

void CAP_PIX(finish)(const struct cap_pix *j, const struct cap_pix_bins *v, int32_t n, float *out)
{
    converted(j, v, n, out);
    if (j->maps != NULL)
        CAP_PIX(mapped)(j, (size_t)(out - j->base), (size_t)n * (j->nch == 3 ? 4 : 1), out);
}

void CAP_PIX(ways)(struct cap_pix_ways *w)
{
    w->sums = CAP_PIX(sums);
    w->bayer = CAP_PIX(bayer);
    w->mosaic = CAP_PIX(mosaic);
    w->mapped = CAP_PIX(mapped);
}
