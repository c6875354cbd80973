/* kernels_avx2.c - AVX2 + FMA variants.
 *
 * gather4: one 128-bit FMA per entry, the lanes being the channels; four accumulators hide its
 * latency.  Wider vectors would need as many loads, and loads are what limits it.
 * gather1: eight scalar loads into a vector are no faster than scalar FMAs; four chains. */
#include <stddef.h>

#include "recon/simd/kernels.h"

#if !defined(__AVX2__) || !defined(__FMA__) || !defined(__BMI2__)
#error "kernels_avx2.c needs -mavx2 -mfma -mbmi2"
#endif
#include <immintrin.h>

static inline __m128 fma4(__m128 s, const struct rec_entry *e, const float *in)
{
    return _mm_fmadd_ps(_mm_broadcast_ss(&e->val), _mm_load_ps(in + (size_t)e->idx * 4), s);
}

static void simd_gather4(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in,
                         float *out)
{
    const struct rec_entry *e = g->entry + g->ptr[i0];
    for (int32_t i = i0; i < i1; i++) {
        const struct rec_entry *end = g->entry + g->ptr[i + 1];
        __m128 s0 = _mm_setzero_ps(), s1 = s0, s2 = s0, s3 = s0;
        for (; end - e >= 4; e += 4) {
            s0 = fma4(s0, e, in);
            s1 = fma4(s1, e + 1, in);
            s2 = fma4(s2, e + 2, in);
            s3 = fma4(s3, e + 3, in);
        }
        for (; e < end; e++)
            s0 = fma4(s0, e, in);
        _mm_store_ps(out + (size_t)i * 4, _mm_add_ps(_mm_add_ps(s0, s1), _mm_add_ps(s2, s3)));
    }
}

static void simd_gather1(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in,
                         float *out)
{
    const struct rec_entry *e = g->entry + g->ptr[i0];
    for (int32_t i = i0; i < i1; i++) {
        const struct rec_entry *end = g->entry + g->ptr[i + 1];
        float s[4] = {0};
        for (; end - e >= 4; e += 4)
            for (int k = 0; k < 4; k++)
                s[k] = __builtin_fmaf(e[k].val, in[e[k].idx], s[k]);
        for (; e < end; e++)
            s[0] = __builtin_fmaf(e->val, in[e->idx], s[0]);
        out[i] = (s[0] + s[1]) + (s[2] + s[3]);
    }
}

void rec_kernels_avx2(struct rec_kernels *k)
{
    k->gather1 = simd_gather1;
    k->gather4 = simd_gather4;
}
