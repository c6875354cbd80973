/* windows_avx512.c - products with windows of four channels, AVX-512: four pixels are a vector, sixteen
 * weights are widened at once.  One channel is as wide as AVX2's vectors are already. */
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
INLINE size_t first_of(const struct rec_windows *m, int32_t q, int32_t slot)
{
    return (size_t)q * (size_t)m->slots + (size_t)slot;
}

INLINE void adjoint4_rows(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                          const float *y, float *x, int high)
{
    const __m128 unit = _mm_set1_ps(m->unit);
    for (int32_t q = q0; q < q1; q++) {
        __m512 sum[4] = {_mm512_setzero_ps(), _mm512_setzero_ps(), _mm512_setzero_ps(),
                         _mm512_setzero_ps()};
        for (int32_t slot = s.s0; slot < s.s1; slot++) {
            size_t at = first_of(m, q, slot), pitch = (size_t)m->pitch[slot] * 4;
            __m512 w = weights16(m->w + at * (size_t)high * 4);
            const float *v = y + (size_t)m->at[at] * 4;
            for (int r = 0; r < high; r++)
                sum[r] =
                    _mm512_fmadd_ps(spread(w, r), _mm512_loadu_ps(v + (size_t)r * pitch), sum[r]);
        }
        __m512 all = _mm512_add_ps(_mm512_add_ps(sum[0], sum[1]), _mm512_add_ps(sum[2], sum[3]));
        _mm_store_ps(x + (size_t)q * 4, _mm_mul_ps(unit, fold(all)));
    }
}
INLINE void scatter4_rows(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                          const float *x, float *y, int high)
{
    for (int32_t q = q0; q < q1; q++) {
        __m512 xx = _mm512_broadcast_f32x4(_mm_load_ps(x + (size_t)q * 4));
        for (int32_t slot = s.s0; slot < s.s1; slot++) {
            size_t at = first_of(m, q, slot), pitch = (size_t)m->pitch[slot] * 4;
            __m512 w = weights16(m->w + at * (size_t)high * 4);
            float *v = y + (size_t)m->at[at] * 4;
            for (int r = 0; r < high; r++, v += pitch)
                _mm512_storeu_ps(v, _mm512_fmadd_ps(spread(w, r), xx, _mm512_loadu_ps(v)));
        }
    }
}

/* 2x2: a window is a vector, four cameras have sixteen weights. */
INLINE __m512 load2x2(const float *v, size_t pitch)
{
    __m512d first = _mm512_castpd256_pd512(_mm256_castps_pd(_mm256_loadu_ps(v)));
    return _mm512_castpd_ps(
        _mm512_insertf64x4(first, _mm256_castps_pd(_mm256_loadu_ps(v + pitch)), 1));
}
INLINE void add_2x2(float *v, size_t pitch, __m512 add)
{
    __m256 low = _mm512_castps512_ps256(add);
    __m256 high = _mm256_castpd_ps(_mm512_extractf64x4_pd(_mm512_castps_pd(add), 1));
    _mm256_storeu_ps(v, _mm256_add_ps(_mm256_loadu_ps(v), low));
    _mm256_storeu_ps(v + pitch, _mm256_add_ps(_mm256_loadu_ps(v + pitch), high));
}
INLINE void adjoint4_2x2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                         const float *y, float *x)
{
    const __m128 unit = _mm_set1_ps(m->unit);
    for (int32_t q = q0; q < q1; q++) {
        __m512 sum[2] = {_mm512_setzero_ps(), _mm512_setzero_ps()};
        for (int32_t slot = s.s0; slot < s.s1; slot += REC_SLOT_GROUP) {
            size_t at = first_of(m, q, slot);
            __m512 w = weights16(m->w + at * 4);
            for (int c = 0; c < REC_SLOT_GROUP && slot + c < s.s1; c++) {
                __m512 v =
                    load2x2(y + (size_t)m->at[at + (size_t)c] * 4, (size_t)m->pitch[slot + c] * 4);
                sum[c & 1] = _mm512_fmadd_ps(spread(w, c), v, sum[c & 1]);
            }
        }
        _mm_store_ps(x + (size_t)q * 4, _mm_mul_ps(unit, fold(_mm512_add_ps(sum[0], sum[1]))));
    }
}
INLINE void scatter4_2x2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                         const float *x, float *y)
{
    for (int32_t q = q0; q < q1; q++) {
        __m512 xx = _mm512_broadcast_f32x4(_mm_load_ps(x + (size_t)q * 4));
        for (int32_t slot = s.s0; slot < s.s1; slot += REC_SLOT_GROUP) {
            size_t at = first_of(m, q, slot);
            __m512 w = weights16(m->w + at * 4);
            for (int c = 0; c < REC_SLOT_GROUP && slot + c < s.s1; c++)
                add_2x2(y + (size_t)m->at[at + (size_t)c] * 4, (size_t)m->pitch[slot + c] * 4,
                        _mm512_mul_ps(spread(w, c), xx));
        }
    }
}

REC_BY_SHAPE(adjoint4)
REC_BY_SHAPE(scatter4)

void rec_windows_avx512(struct rec_kernels *k)
{
    k->adjoint4 = adjoint4;
    k->scatter4 = scatter4;
}
