/* kernels_avx2.c - AVX2 + FMA variants.
 *
 * A column has few entries in one camera (a voxel covers some 2x2..3x3 bins) and their number
 * varies, so a loop that ends with the column mispredicts its end nearly every time, which costs
 * more than the work.  So entries are taken in fixed groups of 8; those past the column's end get
 * weight 0.  Groups that would reach past nnz, and the tail of the block, take the plain loop. */
#include "recon/simd/simd.h"

#if !defined(__AVX2__) || !defined(__FMA__)
#error "kernels_avx2.c needs -mavx2 -mfma"
#endif
#include <immintrin.h>

#define GROUP 8

/* Weights of entries e..e+7, 0 where e+i >= end. */
static inline void weights(const float *val, uint32_t e, uint32_t end, float out[GROUP])
{
    const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    __m256i left = _mm256_set1_epi32((int)(end - e));
    __m256 keep = _mm256_castsi256_ps(_mm256_cmpgt_epi32(left, lane));
    _mm256_store_ps(out, _mm256_and_ps(_mm256_loadu_ps(val + e), keep));
}

static void scatter4(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                     const float *x, float *y)
{
    const uint32_t *row = b->row;
    float v[GROUP] __attribute__((aligned(32)));
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = b->colptr[col[q]], end = b->colptr[col[q] + 1];
        __m128 xq = _mm_load_ps(x + (size_t)q * 4);
        for (; e < end && (uint64_t)e + GROUP <= b->nnz; e += GROUP) {
            weights(b->val, e, end, v);
            for (int i = 0; i < GROUP; i++) {
                float *p = y + (size_t)row[e + i] * 4;
                _mm_store_ps(p, _mm_fmadd_ps(_mm_broadcast_ss(v + i), xq, _mm_load_ps(p)));
            }
        }
        for (; e < end; e++) {
            float *p = y + (size_t)row[e] * 4;
            _mm_store_ps(p, _mm_fmadd_ps(_mm_broadcast_ss(b->val + e), xq, _mm_load_ps(p)));
        }
    }
}

static void gather4(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                    const float *y, float *x)
{
    const uint32_t *row = b->row;
    float v[GROUP] __attribute__((aligned(32)));
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = b->colptr[col[q]], end = b->colptr[col[q] + 1];
        __m128 s0 = _mm_setzero_ps(), s1 = s0;
        for (; e < end && (uint64_t)e + GROUP <= b->nnz; e += GROUP) {
            weights(b->val, e, end, v);
            for (int i = 0; i < GROUP; i += 2) {
                s0 = _mm_fmadd_ps(_mm_broadcast_ss(v + i), _mm_load_ps(y + (size_t)row[e + i] * 4),
                                  s0);
                s1 = _mm_fmadd_ps(_mm_broadcast_ss(v + i + 1),
                                  _mm_load_ps(y + (size_t)row[e + i + 1] * 4), s1);
            }
        }
        for (; e < end; e++)
            s0 = _mm_fmadd_ps(_mm_broadcast_ss(b->val + e), _mm_load_ps(y + (size_t)row[e] * 4),
                              s0);
        float *p = x + (size_t)q * 4;
        _mm_store_ps(p, _mm_add_ps(_mm_load_ps(p), _mm_add_ps(s0, s1)));
    }
}

static void scatter1(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                     const float *x, float *y)
{
    const uint32_t *row = b->row;
    float v[GROUP] __attribute__((aligned(32)));
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = b->colptr[col[q]], end = b->colptr[col[q] + 1];
        for (; e < end && (uint64_t)e + GROUP <= b->nnz; e += GROUP) {
            weights(b->val, e, end, v);
            for (int i = 0; i < GROUP; i++)
                y[row[e + i]] = __builtin_fmaf(v[i], x[q], y[row[e + i]]);
        }
        for (; e < end; e++)
            y[row[e]] = __builtin_fmaf(b->val[e], x[q], y[row[e]]);
    }
}

static void gather1(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                    const float *y, float *x)
{
    const uint32_t *row = b->row;
    float v[GROUP] __attribute__((aligned(32)));
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = b->colptr[col[q]], end = b->colptr[col[q] + 1];
        float s0 = 0, s1 = 0;
        for (; e < end && (uint64_t)e + GROUP <= b->nnz; e += GROUP) {
            weights(b->val, e, end, v);
            for (int i = 0; i < GROUP; i += 2) {
                s0 = __builtin_fmaf(v[i], y[row[e + i]], s0);
                s1 = __builtin_fmaf(v[i + 1], y[row[e + i + 1]], s1);
            }
        }
        for (; e < end; e++)
            s0 = __builtin_fmaf(b->val[e], y[row[e]], s0);
        x[q] += s0 + s1;
    }
}

void rec_kernels_avx2(struct rec_kernels *k)
{
    *k = (struct rec_kernels){.name = "avx2",
                              .scatter1 = scatter1,
                              .scatter4 = scatter4,
                              .gather1 = gather1,
                              .gather4 = gather4};
}
