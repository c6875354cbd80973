/* wide.h - REC_WIDE floats at once, the width of the CPU's sums, for loops over a vector whatever its lanes are.
 *
 * As lanes.h, with REC_WIDE 8 where there is AVX2, else 4: two elements or one of four lanes (cs 4), eight or four of
 * one lane (cs 1).  Positions count floats, not elements.  The last step of a loop may have only m floats; the
 * missing ones are read as 0 and are not written.  Two partial sums take alternate groups of four floats, so that
 * they do not depend on REC_WIDE.
 * Private to the solvers. */
#ifndef REC_WIDE_H
#define REC_WIDE_H
#include <math.h>
#include <string.h>

#include "recon/simd/lanes.h"

#ifdef __AVX2__
#define REC_WIDE 8
#else
#define REC_WIDE 4
#endif
typedef float rec_fw __attribute__((vector_size(REC_WIDE * 4), may_alias));
typedef float rec_fwu __attribute__((vector_size(REC_WIDE * 4), aligned(4), may_alias));
typedef int32_t rec_iw __attribute__((vector_size(REC_WIDE * 4), may_alias));
struct rec_sum {
    rec_d4 half[2];
};

REC_INLINE rec_fw rec_wide(const float *v, size_t i, size_t m)
{
    if (m == REC_WIDE)
        return (rec_fw) * (const rec_fwu *)(v + i);
    float part[REC_WIDE] = {0};
    memcpy(part, v + i, m * sizeof *part);
    return (rec_fw) * (const rec_fwu *)part;
}
REC_INLINE void rec_put_wide(float *v, size_t i, size_t m, rec_fw a)
{
    if (m == REC_WIDE)
        *(rec_fwu *)(v + i) = (rec_fwu)a;
    else
        memcpy(v + i, &a, m * sizeof *v);
}
/* Floats 4h ... 4h+3. */
REC_INLINE rec_f4 rec_four(rec_fw a, size_t h)
{
#ifdef __AVX2__
    return h ? _mm256_extractf128_ps(a, 1) : _mm256_castps256_ps128(a);
#else
    (void)h;
    return a;
#endif
}
/* a and b as one vector; a alone where REC_WIDE is 4. */
REC_INLINE rec_fw rec_pair(rec_f4 a, rec_f4 b)
{
#ifdef __AVX2__
    return _mm256_insertf128_ps(_mm256_castps128_ps256(a), b, 1);
#else
    (void)b;
    return a;
#endif
}
REC_INLINE rec_fw rec_wide_splat(float a)
{
    return rec_pair(rec_splat(a), rec_splat(a));
}
REC_INLINE rec_fw rec_wide_lanes(const double a[4], size_t cs)
{
    rec_f4 four = cs == 4 ? rec_coef(a) : rec_splat((float)a[0]);
    return rec_pair(four, four);
}
/* Values given per element: the same for all its lanes. */
REC_INLINE rec_fw rec_wide_each(const float *v, size_t i, size_t m, size_t cs)
{
    if (cs != 4)
        return rec_wide(v, i, m);
    v += i / 4;
#ifdef __AVX2__
    double two = 0;
    memcpy(&two, v, m == REC_WIDE ? sizeof two : sizeof *v);
    return _mm256_permutevar_ps(_mm256_castpd_ps(_mm256_set1_pd(two)),
                                _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1));
#else
    return rec_splat(*v);
#endif
}
/* a where the mask is all ones, else b. */
REC_INLINE rec_fw rec_wide_select(rec_iw mask, rec_fw a, rec_fw b)
{
#ifdef __AVX2__
    return _mm256_blendv_ps(b, a, (__m256)mask);
#else
    return rec_select(mask, a, b);
#endif
}
REC_INLINE rec_fw rec_wide_root(rec_fw a)
{
#ifdef __AVX2__
    return _mm256_sqrt_ps(a);
#elif defined(__SSE2__)
    return _mm_sqrt_ps(a);
#else
    return (rec_fw){sqrtf(a[0]), sqrtf(a[1]), sqrtf(a[2]), sqrtf(a[3])};
#endif
}
/* Whether the mask holds in floats 4h ... 4h+3; everywhere. */
REC_INLINE bool rec_all_of(rec_iw mask, size_t h)
{
    return rec_all((rec_i4)rec_four((rec_fw)mask, h));
}
REC_INLINE bool rec_wide_all(rec_iw mask)
{
    return rec_all_of(mask, 0) && rec_all_of(mask, REC_WIDE / 4 - 1);
}
/* *sum += a b in double.  h: the half of *sum to which the floats belong; 0 where REC_WIDE is 8. */
REC_INLINE void rec_wide_add(struct rec_sum *sum, size_t h, rec_fw a, rec_fw b)
{
    rec_add_product(&sum->half[h], rec_four(a, 0), rec_four(b, 0));
    if (REC_WIDE == 8)
        rec_add_product(&sum->half[1], rec_four(a, 1), rec_four(b, 1));
}
/* The sum of each lane; with one channel, the sum of all in the first lane. */
REC_INLINE void rec_put_sum(double out[4], const struct rec_sum *sum, size_t cs)
{
    double u[4], v[4];
    rec_put(u, &sum->half[0]);
    rec_put(v, &sum->half[1]);
    for (int l = 0; l < 4; l++)
        out[l] = u[l] + v[l];
    if (cs == 4)
        return;
    out[0] = (out[0] + out[1]) + (out[2] + out[3]);
    out[1] = out[2] = out[3] = 0;
}

#endif
