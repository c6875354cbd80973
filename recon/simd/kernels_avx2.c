/* kernels_avx2.c - AVX2 + FMA variants.
 *
 * gather4: one 128-bit FMA per entry, the lanes being the channels; four accumulators hide its
 * latency.  Wider vectors would need as many loads, and loads are what limits it.
 * gather1: eight scalar loads into a vector are no faster than scalar FMAs; four chains. */
#include <stddef.h>

#include "recon/solve/passes/pcg_pass.h"
#include "recon/simd/simd.h"

#if !defined(__AVX2__) || !defined(__FMA__) || !defined(__BMI2__)
#error "kernels_avx2.c needs -mavx2 -mfma -mbmi2"
#endif
#include <immintrin.h>

static inline __m128 fma4(__m128 s, const struct rec_entry *e, const float *in)
{
    return _mm_fmadd_ps(_mm_broadcast_ss(&e->val), _mm_load_ps(in + (size_t)e->idx * 4), s);
}

static void gather4(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in, float *out)
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

static void gather1(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in, float *out)
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

/* Index of an entry: its low bits, masked as it is loaded. */
static inline const float *at4(const float *in, const uint32_t *e, uint32_t bits)
{
    return in + (size_t)_bzhi_u32(*e, bits) * 4;
}

static void packed4(const struct rec_packed *g, int32_t i0, int32_t i1, const float *in, float *out)
{
    const uint32_t *e = g->entry + g->ptr[i0], bits = g->bits;
    const __m128i shift = _mm_cvtsi32_si128((int)bits);
    const __m128 unit = _mm_set1_ps(g->unit);
    for (int32_t i = i0; i < i1; i++) {
        const uint32_t *end = g->entry + g->ptr[i + 1];
        __m128 s0 = _mm_setzero_ps(), s1 = s0, s2 = s0, s3 = s0;
        for (; end - e >= 4; e += 4) {
            __m128i four = _mm_loadu_si128((const __m128i *)(const void *)e);
            __m128 v = _mm_cvtepi32_ps(_mm_srl_epi32(four, shift));
            s0 = _mm_fmadd_ps(_mm_permute_ps(v, 0x00), _mm_load_ps(at4(in, e, bits)), s0);
            s1 = _mm_fmadd_ps(_mm_permute_ps(v, 0x55), _mm_load_ps(at4(in, e + 1, bits)), s1);
            s2 = _mm_fmadd_ps(_mm_permute_ps(v, 0xaa), _mm_load_ps(at4(in, e + 2, bits)), s2);
            s3 = _mm_fmadd_ps(_mm_permute_ps(v, 0xff), _mm_load_ps(at4(in, e + 3, bits)), s3);
        }
        for (; e < end; e++)
            s0 = _mm_fmadd_ps(_mm_set1_ps((float)(*e >> bits)), _mm_load_ps(at4(in, e, bits)), s0);
        s0 = _mm_add_ps(_mm_add_ps(s0, s1), _mm_add_ps(s2, s3));
        _mm_store_ps(out + (size_t)i * 4, _mm_mul_ps(unit, s0));
    }
}

static void packed1(const struct rec_packed *g, int32_t i0, int32_t i1, const float *in, float *out)
{
    const uint32_t *e = g->entry + g->ptr[i0], bits = g->bits;
    for (int32_t i = i0; i < i1; i++) {
        const uint32_t *end = g->entry + g->ptr[i + 1];
        float s[4] = {0};
        for (; end - e >= 4; e += 4)
            for (int k = 0; k < 4; k++)
                s[k] = __builtin_fmaf((float)(e[k] >> bits), in[_bzhi_u32(e[k], bits)], s[k]);
        for (; e < end; e++)
            s[0] = __builtin_fmaf((float)(*e >> bits), in[_bzhi_u32(*e, bits)], s[0]);
        out[i] = g->unit * ((s[0] + s[1]) + (s[2] + s[3]));
    }
}

void rec_kernels_avx2(struct rec_kernels *k)
{
    *k = (struct rec_kernels){.name = "avx2",
                              .gather1 = gather1,
                              .gather4 = gather4,
                              .packed1 = packed1,
                              .packed4 = packed4,
                              .pcg = &rec_pcg_passes_avx2};
}
