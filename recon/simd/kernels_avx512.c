/* kernels_avx512.c - AVX-512 variants.
 *
 * gather4: four entries at a time, one per 128-bit lane: their values are spread by one permutation
 * and multiplied by one FMA where AVX2 needs four of each; loads limit it, and there are nine per
 * four entries instead of twelve.
 * gather1 and the other loops are those of AVX2. */
#include <stddef.h>

#include "recon/simd/kernels.h"

#if !defined(__AVX512F__) || !defined(__AVX512VL__)
#error "kernels_avx512.c needs -mavx512f -mavx512vl"
#endif
#include <immintrin.h>

static inline __m512 fma16(__m512 s, const struct rec_entry *e, const float *in)
{
    const __m512i spread = _mm512_setr_epi32(1, 1, 1, 1, 3, 3, 3, 3, 5, 5, 5, 5, 7, 7, 7, 7);
    __m512 x = _mm512_castps128_ps512(_mm_load_ps(in + (size_t)e[0].idx * 4));
    x = _mm512_insertf32x4(x, _mm_load_ps(in + (size_t)e[1].idx * 4), 1);
    x = _mm512_insertf32x4(x, _mm_load_ps(in + (size_t)e[2].idx * 4), 2);
    x = _mm512_insertf32x4(x, _mm_load_ps(in + (size_t)e[3].idx * 4), 3);
    __m512 four = _mm512_castps256_ps512(_mm256_loadu_ps((const float *)(const void *)e));
    return _mm512_fmadd_ps(_mm512_permutexvar_ps(spread, four), x, s);
}

static inline __m128 simd_fold(__m512 s)
{
    __m256 half = _mm256_add_ps(_mm512_castps512_ps256(s),
                                _mm256_castpd_ps(_mm512_extractf64x4_pd(_mm512_castps_pd(s), 1)));
    return _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1));
}

static void kernels_avx512_gather4(const struct rec_gather *g, int32_t i0, int32_t i1,
                                   const float *in, float *out)
{
    const struct rec_entry *e = g->entry + g->ptr[i0];
    for (int32_t i = i0; i < i1; i++) {
        const struct rec_entry *end = g->entry + g->ptr[i + 1];
        __m512 s0 = _mm512_setzero_ps(), s1 = s0;
        __m128 s = _mm_setzero_ps();
        for (; end - e >= 8; e += 8) {
            s0 = fma16(s0, e, in);
            s1 = fma16(s1, e + 4, in);
        }
        if (end - e >= 4) {
            s0 = fma16(s0, e, in);
            e += 4;
        }
        for (; e < end; e++)
            s = _mm_fmadd_ps(_mm_broadcast_ss(&e->val), _mm_load_ps(in + (size_t)e->idx * 4), s);
        s = _mm_add_ps(s, simd_fold(_mm512_add_ps(s0, s1)));
        _mm_store_ps(out + (size_t)i * 4, s);
    }
}

void rec_kernels_avx512(struct rec_kernels *k)
{
    k->gather4 = kernels_avx512_gather4;
}
