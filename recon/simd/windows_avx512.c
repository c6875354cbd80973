/* windows_avx512.c - the product that gathers, for windows with rows of four pixels and four channels, AVX-512: four
 * pixels are a vector, and sixteen weights are widened at once.  Everything else is faster with AVX2: one channel and
 * 2x2 windows fit its vectors, and its stores cross a cache line half as often. */
#include "recon/simd/kernels.h"
#include "recon/simd/windows_shapes.h"

#if !defined(__AVX512F__) || !defined(__AVX512VL__)
#error "windows_avx512.c needs -mavx512f -mavx512vl"
#endif
#include <immintrin.h>

#define INLINE static inline __attribute__((always_inline))

INLINE __m512 weights16(const uint8_t *w)
{
    return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const void *)w)));
}
/* Weights 4r ... 4r+3 of sixteen, each for four channels. */
INLINE __m512 spread(__m512 w, int r)
{
    const int a = 4 * r, b = a + 1, c = a + 2, d = a + 3;
    return _mm512_permutexvar_ps(_mm512_setr_epi32(a, a, a, a, b, b, b, b, c, c, c, c, d, d, d, d),
                                 w);
}
INLINE __m128 fold(__m512 s)
{
    __m256 half = _mm256_add_ps(_mm512_castps512_ps256(s),
                                _mm256_castpd_ps(_mm512_extractf64x4_pd(_mm512_castps_pd(s), 1)));
    return _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1));
}
INLINE void adjoint4_rows(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                          const float *y, float *x, int high)
{
    const __m128 unit = _mm_set1_ps(m->unit);
    struct walk k;
    walk_from(&k, m, s, q0, (size_t)high * 4, 4);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        __m512 sum[4] = {_mm512_setzero_ps(), _mm512_setzero_ps(), _mm512_setzero_ps(),
                         _mm512_setzero_ps()};
        for (int32_t c = 0; c < k.slots; c++) {
            __m512 w = weights16(k.w + (size_t)c * (size_t)high * 4);
            const float *v = y + (size_t)k.at[c] * 4;
            for (int r = 0; r < high; r++, v += k.pitch[c])
                sum[r] = _mm512_fmadd_ps(spread(w, r), _mm512_loadu_ps(v), sum[r]);
        }
        __m512 all = _mm512_add_ps(_mm512_add_ps(sum[0], sum[1]), _mm512_add_ps(sum[2], sum[3]));
        _mm_store_ps(x + (size_t)q * 4, _mm_mul_ps(unit, fold(all)));
    }
}
/* ---- one channel -------------------------------------------------------------------------------- */

/* The rows of a window as one vector, 0 where there is none. */
INLINE __m512 rows_of(const float *v, size_t pitch, int high)
{
    __m512 all = _mm512_zextps128_ps512(_mm_loadu_ps(v));
    all = _mm512_insertf32x4(all, _mm_loadu_ps(v + pitch), 1);
    all = _mm512_insertf32x4(all, _mm_loadu_ps(v + 2 * pitch), 2);
    return high == 4 ? _mm512_insertf32x4(all, _mm_loadu_ps(v + 3 * pitch), 3) : all;
}
INLINE float fold16(__m512 s)
{
    __m128 a = fold(s);
    a = _mm_add_ps(a, _mm_movehl_ps(a, a));
    return _mm_cvtss_f32(_mm_add_ss(a, _mm_movehdup_ps(a)));
}
/* `columns`: one, or two whose windows lie at the same places; each bin is read once. */
INLINE void adjoint1_columns(const struct walk *k, const float *y, float unit, float *x, int high,
                             int columns)
{
    const __mmask16 have = high == 4 ? 0xffff : 0x0fff;
    __m512 sum[2] = {_mm512_setzero_ps(), _mm512_setzero_ps()};
    for (int32_t c = 0; c < k->slots; c++) {
        const uint8_t *w = k->w + (size_t)c * (size_t)high * 4;
        __m512 v = rows_of(y + k->at[c], k->pitch[c], high);
        for (int i = 0; i < columns; i++, w += k->columns_w)
            sum[i] = _mm512_mask3_fmadd_ps(weights16(w), v, sum[i], have);
    }
    for (int i = 0; i < columns; i++)
        x[i] = unit * fold16(sum[i]);
}
INLINE void adjoint1_rows(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                          const float *y, float *x, int high)
{
    struct walk k;
    walk_from(&k, m, s, q0, (size_t)high * 4, 1);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        if (q + 1 < q1 && walk_two(&k)) {
            adjoint1_columns(&k, y, m->unit, x + q++, high, 2);
            walk_on(&k);
        } else {
            adjoint1_columns(&k, y, m->unit, x + q, high, 1);
        }
    }
}
static void adjoint1(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                     const float *y, float *x)
{
    if (m->high == 2)
        rec_adjoint1_avx2(m, s, q0, q1, y, x);
    else if (m->high == 3)
        adjoint1_rows(m, s, q0, q1, y, x, 3);
    else
        adjoint1_rows(m, s, q0, q1, y, x, 4);
}

INLINE void put_rows(float *v, size_t pitch, __m512 all, int high)
{
    _mm_storeu_ps(v, _mm512_castps512_ps128(all));
    _mm_storeu_ps(v + pitch, _mm512_extractf32x4_ps(all, 1));
    _mm_storeu_ps(v + 2 * pitch, _mm512_extractf32x4_ps(all, 2));
    if (high == 4)
        _mm_storeu_ps(v + 3 * pitch, _mm512_extractf32x4_ps(all, 3));
}
INLINE void scatter1_columns(const struct walk *k, const float *x, float *y, int high, int columns)
{
    const __m512 x0 = _mm512_set1_ps(x[0]), x1 = _mm512_set1_ps(x[columns - 1]);
    for (int32_t c = 0; c < k->slots; c++) {
        const uint8_t *w = k->w + (size_t)c * (size_t)high * 4;
        float *v = y + k->at[c];
        __m512 sum = _mm512_fmadd_ps(weights16(w), x0, rows_of(v, k->pitch[c], high));
        if (columns == 2)
            sum = _mm512_fmadd_ps(weights16(w + k->columns_w), x1, sum);
        put_rows(v, k->pitch[c], sum, high);
    }
}
INLINE void scatter1_rows(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                          const float *x, float *y, int high)
{
    struct walk k;
    walk_from(&k, m, s, q0, (size_t)high * 4, 1);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        if (q + 1 < q1 && walk_two(&k)) {
            scatter1_columns(&k, x + q++, y, high, 2);
            walk_on(&k);
        } else {
            scatter1_columns(&k, x + q, y, high, 1);
        }
    }
}
static void scatter1(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                     const float *x, float *y)
{
    if (m->high == 2)
        rec_scatter1_avx2(m, s, q0, q1, x, y);
    else if (m->high == 3)
        scatter1_rows(m, s, q0, q1, x, y, 3);
    else
        scatter1_rows(m, s, q0, q1, x, y, 4);
}

/* ---- by shape ----------------------------------------------------------------------------------- */

static void adjoint4(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                     const float *y, float *x)
{
    if (m->wide == 2)
        rec_adjoint4_avx2(m, s, q0, q1, y, x);
    else if (m->high == 2)
        adjoint4_rows(m, s, q0, q1, y, x, 2);
    else if (m->high == 3)
        adjoint4_rows(m, s, q0, q1, y, x, 3);
    else
        adjoint4_rows(m, s, q0, q1, y, x, 4);
}

void rec_windows_avx512(struct rec_kernels *k)
{
    k->adjoint1 = adjoint1;
    k->adjoint4 = adjoint4;
    k->scatter1 = scatter1;
}
