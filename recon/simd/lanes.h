/* lanes.h - the channels of one voxel or ray as a vector of four floats, for any CPU.
 *
 * GCC and Clang vector extensions; cs = 4: all lanes, cs = 1: lane 0, the others 0; cs = REC_QUAD: four
 * voxels or rays of one channel, element i the first of them.  cs is a constant where these are used, so
 * each caller compiles to loads of its own width.
 * Private to the solvers. */
#ifndef REC_LANES_H
#define REC_LANES_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#if defined(__AVX2__)
#include <immintrin.h>
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

typedef float rec_f4 __attribute__((vector_size(16), may_alias));
typedef float rec_f4u __attribute__((vector_size(16), aligned(4), may_alias));
typedef int32_t rec_i4 __attribute__((vector_size(16), may_alias));
typedef double rec_d2 __attribute__((vector_size(16)));
typedef double rec_dv __attribute__((vector_size(32)));
typedef struct {
#ifdef __AVX2__
    rec_dv v;
#else
    rec_d2 lo, hi; /* two registers on any CPU */
#endif
} rec_d4;
#define REC_INLINE static inline __attribute__((always_inline))
#define REC_QUAD   ((size_t)16)

REC_INLINE rec_f4 rec_ld(const float *v, size_t i, size_t cs)
{
    return cs == 4          ? *(const rec_f4 *)(v + i * 4)
           : cs == REC_QUAD ? (rec_f4) * (const rec_f4u *)(v + i)
                            : (rec_f4){v[i], 0, 0, 0};
}
REC_INLINE void rec_st(float *v, size_t i, size_t cs, rec_f4 a)
{
    if (cs == 4)
        *(rec_f4 *)(v + i * 4) = a;
    else if (cs == REC_QUAD)
        *(rec_f4u *)(v + i) = (rec_f4u)a;
    else
        v[i] = a[0];
}
REC_INLINE rec_f4 rec_splat(float a)
{
    return (rec_f4){a, a, a, a};
}
REC_INLINE rec_f4 rec_coef(const double a[4])
{
    return (rec_f4){(float)a[0], (float)a[1], (float)a[2], (float)a[3]};
}
/* Values given per element (the same for all its lanes); values given per channel. */
REC_INLINE rec_f4 rec_of_each(const float *v, size_t i, size_t cs)
{
    return cs == REC_QUAD ? rec_ld(v, i, cs) : rec_splat(v[i]);
}
REC_INLINE rec_f4 rec_of_lanes(const double a[4], size_t cs)
{
    return cs == REC_QUAD ? rec_splat((float)a[0]) : rec_coef(a);
}
/* a where the mask is all ones, else b; masks are what comparisons give. */
REC_INLINE rec_f4 rec_select(rec_i4 mask, rec_f4 a, rec_f4 b)
{
#ifdef __AVX2__
    return _mm_blendv_ps(b, a, (__m128)mask);
#else
    return (rec_f4)((mask & (rec_i4)a) | (~mask & (rec_i4)b));
#endif
}
/* Whether the mask holds in all four lanes; in any. */
REC_INLINE bool rec_all(rec_i4 mask)
{
#ifdef __SSE2__
    return _mm_movemask_ps((__m128)mask) == 15;
#else
    return (mask[0] & mask[1] & mask[2] & mask[3]) != 0;
#endif
}
REC_INLINE bool rec_any(rec_i4 mask)
{
#ifdef __SSE2__
    return _mm_movemask_ps((__m128)mask) != 0;
#else
    return (mask[0] | mask[1] | mask[2] | mask[3]) != 0;
#endif
}
#ifdef __AVX2__
/* *sum += a b in double. */
REC_INLINE void rec_add_product(rec_d4 *sum, rec_f4 a, rec_f4 b)
{
#ifdef __FMA__ /* a product of two floats is exact in double: the same bits */
    sum->v = (rec_dv)_mm256_fmadd_pd(_mm256_cvtps_pd(a), _mm256_cvtps_pd(b), (__m256d)sum->v);
#else
    sum->v += (rec_dv)_mm256_cvtps_pd(a) * (rec_dv)_mm256_cvtps_pd(b);
#endif
}
REC_INLINE void rec_put(double out[4], const rec_d4 *sum)
{
    for (int l = 0; l < 4; l++)
        out[l] = sum->v[l];
}
#else
REC_INLINE void rec_widen(rec_f4 a, rec_d2 *lo, rec_d2 *hi)
{
#ifdef __SSE2__ /* compilers do not turn the generic form into this */
    *lo = _mm_cvtps_pd(a);
    *hi = _mm_cvtps_pd(_mm_movehl_ps(a, a));
#else
    *lo = (rec_d2){a[0], a[1]};
    *hi = (rec_d2){a[2], a[3]};
#endif
}
/* *sum += a b in double. */
REC_INLINE void rec_add_product(rec_d4 *sum, rec_f4 a, rec_f4 b)
{
    rec_d2 alo, ahi, blo, bhi;
    rec_widen(a, &alo, &ahi);
    rec_widen(b, &blo, &bhi);
    sum->lo += alo * blo;
    sum->hi += ahi * bhi;
}
REC_INLINE void rec_put(double out[4], const rec_d4 *sum)
{
    out[0] = sum->lo[0];
    out[1] = sum->lo[1];
    out[2] = sum->hi[0];
    out[3] = sum->hi[1];
}
#endif

/* Total of `sum`, over single elements, and `quads`, over four elements at a time. */
REC_INLINE void rec_put_both(double out[4], const rec_d4 *sum, const rec_d4 *quads)
{
    double q[4];
    rec_put(out, sum);
    rec_put(q, quads);
    out[0] += (q[0] + q[1]) + (q[2] + q[3]);
}

#endif
