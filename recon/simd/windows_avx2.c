/* windows_avx2.c - products with windows, AVX2 + FMA.
 *
 * Four channels: two pixels are a vector; eight weights are widened at once and each is spread over its
 * pixel by a permutation.  One channel: two rows of four pixels are a vector, or two windows of 2x2. */
#include "recon/simd/kernels.h"
#include "recon/simd/windows_shapes.h"

#if !defined(__AVX2__) || !defined(__FMA__)
#error "windows_avx2.c needs -mavx2 -mfma"
#endif
#include <immintrin.h>

#define INLINE static inline __attribute__((always_inline))

INLINE __m256 weights8(const uint8_t *w)
{
    return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const void *)w)));
}
INLINE __m128 weights4(const uint8_t *w)
{
    return _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_loadu_si32(w)));
}
/* Weights 2p and 2p+1 of eight, each for four channels. */
INLINE __m256 spread(__m256 w, int p)
{
    const int a = 2 * p, b = a + 1;
    return _mm256_permutevar8x32_ps(w, _mm256_setr_epi32(a, a, a, a, b, b, b, b));
}
INLINE __m128 fold(__m256 s)
{
    return _mm_add_ps(_mm256_castps256_ps128(s), _mm256_extractf128_ps(s, 1));
}
INLINE float fold4(__m128 s)
{
    s = _mm_add_ps(s, _mm_movehl_ps(s, s));
    return _mm_cvtss_f32(_mm_add_ss(s, _mm_movehdup_ps(s)));
}
INLINE void add_to(float *y, __m256 w, __m256 x)
{
    _mm256_storeu_ps(y, _mm256_fmadd_ps(w, x, _mm256_loadu_ps(y)));
}

/* ---- four channels ------------------------------------------------------------------------------ */

INLINE void adjoint4_rows(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                          const float *y, float *x, int high)
{
    const __m128 unit = _mm_set1_ps(m->unit);
    struct walk k;
    walk_from(&k, m, s, q0, (size_t)high * 4, 4);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        __m256 a = _mm256_setzero_ps(), b = a, c = a, d = a;
        for (int32_t i = 0; i < k.slots; i++) {
            const uint8_t *weights = k.w + (size_t)i * (size_t)high * 4;
            const float *v = y + (size_t)k.at[i] * 4;
            for (int r = 0; r < high; r += 2, v += 2 * k.pitch[i]) {
                __m256 w = weights8(weights + 4 * r);
                a = _mm256_fmadd_ps(spread(w, 0), _mm256_loadu_ps(v), a);
                b = _mm256_fmadd_ps(spread(w, 1), _mm256_loadu_ps(v + 8), b);
                if (r + 1 == high)
                    break;
                c = _mm256_fmadd_ps(spread(w, 2), _mm256_loadu_ps(v + k.pitch[i]), c);
                d = _mm256_fmadd_ps(spread(w, 3), _mm256_loadu_ps(v + k.pitch[i] + 8), d);
            }
        }
        a = _mm256_add_ps(_mm256_add_ps(a, b), _mm256_add_ps(c, d));
        _mm_store_ps(x + (size_t)q * 4, _mm_mul_ps(unit, fold(a)));
    }
}
/* Two columns whose windows lie at the same places: each bin is read and written once. */
INLINE void add_two(float *y, const __m256 w[2], const __m256 x[2], int p)
{
    __m256 sum = _mm256_fmadd_ps(spread(w[0], p), x[0], _mm256_loadu_ps(y));
    _mm256_storeu_ps(y, _mm256_fmadd_ps(spread(w[1], p), x[1], sum));
}
INLINE void scatter4_two(const struct walk *k, const float *x, float *y, int high)
{
    const __m256 xx[2] = {_mm256_broadcast_ps((const void *)x),
                          _mm256_broadcast_ps((const void *)(x + 4))};
    for (int32_t c = 0; c < k->slots; c++) {
        const uint8_t *weights = k->w + (size_t)c * (size_t)high * 4,
                      *next = weights + k->columns_w;
        float *v = y + (size_t)k->at[c] * 4;
        for (int r = 0; r < high; r += 2, v += 2 * k->pitch[c]) {
            const __m256 w[2] = {weights8(weights + 4 * r), weights8(next + 4 * r)};
            add_two(v, w, xx, 0);
            add_two(v + 8, w, xx, 1);
            if (r + 1 == high)
                break;
            add_two(v + k->pitch[c], w, xx, 2);
            add_two(v + k->pitch[c] + 8, w, xx, 3);
        }
    }
}
INLINE void scatter4_rows(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                          const float *x, float *y, int high)
{
    struct walk k;
    walk_from(&k, m, s, q0, (size_t)high * 4, 4);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        if (q + 1 < q1 && walk_two(&k)) {
            scatter4_two(&k, x + (size_t)q++ * 4, y, high);
            walk_on(&k);
            continue;
        }
        __m256 xx = _mm256_broadcast_ps((const void *)(x + (size_t)q * 4));
        for (int32_t c = 0; c < k.slots; c++) {
            const uint8_t *weights = k.w + (size_t)c * (size_t)high * 4;
            float *v = y + (size_t)k.at[c] * 4;
            for (int r = 0; r < high; r += 2, v += 2 * k.pitch[c]) {
                __m256 w = weights8(weights + 4 * r);
                add_to(v, spread(w, 0), xx);
                add_to(v + 8, spread(w, 1), xx);
                if (r + 1 == high)
                    break;
                add_to(v + k.pitch[c], spread(w, 2), xx);
                add_to(v + k.pitch[c] + 8, spread(w, 3), xx);
            }
        }
    }
}

/* 2x2: the windows of two cameras fill a vector of eight weights.  For an odd last camera, four are unused. */
INLINE void adjoint4_2x2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                         const float *y, float *x)
{
    const __m128 unit = _mm_set1_ps(m->unit);
    struct walk k;
    walk_from(&k, m, s, q0, 4, 4);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        __m256 a = _mm256_setzero_ps(), b = a, c = a, d = a;
        for (int32_t i = 0; i < k.slots; i += 2) {
            __m256 w = weights8(k.w + (size_t)i * 4);
            const float *v = y + (size_t)k.at[i] * 4;
            a = _mm256_fmadd_ps(spread(w, 0), _mm256_loadu_ps(v), a);
            b = _mm256_fmadd_ps(spread(w, 1), _mm256_loadu_ps(v + k.pitch[i]), b);
            if (i + 1 == k.slots)
                break;
            v = y + (size_t)k.at[i + 1] * 4;
            c = _mm256_fmadd_ps(spread(w, 2), _mm256_loadu_ps(v), c);
            d = _mm256_fmadd_ps(spread(w, 3), _mm256_loadu_ps(v + k.pitch[i + 1]), d);
        }
        a = _mm256_add_ps(_mm256_add_ps(a, b), _mm256_add_ps(c, d));
        _mm_store_ps(x + (size_t)q * 4, _mm_mul_ps(unit, fold(a)));
    }
}
INLINE void scatter4_2x2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                         const float *x, float *y)
{
    struct walk k;
    walk_from(&k, m, s, q0, 4, 4);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        __m256 xx = _mm256_broadcast_ps((const void *)(x + (size_t)q * 4));
        for (int32_t c = 0; c < k.slots; c += 2) {
            __m256 w = weights8(k.w + (size_t)c * 4);
            float *v = y + (size_t)k.at[c] * 4;
            add_to(v, spread(w, 0), xx);
            add_to(v + k.pitch[c], spread(w, 1), xx);
            if (c + 1 == k.slots)
                break;
            v = y + (size_t)k.at[c + 1] * 4;
            add_to(v, spread(w, 2), xx);
            add_to(v + k.pitch[c + 1], spread(w, 3), xx);
        }
    }
}

/* ---- one channel -------------------------------------------------------------------------------- */

/* Rows v and v + pitch as one vector. */
INLINE __m256 rows2(const float *v, size_t pitch)
{
    return _mm256_loadu2_m128(v + pitch, v);
}
/* Sums of one column over its windows: of rows 0 and 1, of 2 and 3, of row 2 where it is the last. */
struct sums1 {
    __m256 two, more;
    __m128 one;
};
INLINE void sums1_add(struct sums1 *s, const uint8_t *w, __m256 two, __m256 more, int high)
{
    s->two = _mm256_fmadd_ps(weights8(w), two, s->two);
    if (high == 3)
        s->one = _mm_fmadd_ps(weights4(w + 8), _mm256_castps256_ps128(more), s->one);
    if (high == 4)
        s->more = _mm256_fmadd_ps(weights8(w + 8), more, s->more);
}
INLINE float sums1_all(const struct sums1 *s)
{
    return fold4(_mm_add_ps(s->one, fold(_mm256_add_ps(s->two, s->more))));
}
/* `columns`: one, or two whose windows lie at the same places; each bin is read once. */
INLINE void adjoint1_columns(const struct walk *k, const float *y, float unit, float *x, int high,
                             int columns)
{
    struct sums1 s[2] = {{_mm256_setzero_ps(), _mm256_setzero_ps(), _mm_setzero_ps()},
                         {_mm256_setzero_ps(), _mm256_setzero_ps(), _mm_setzero_ps()}};
    for (int32_t c = 0; c < k->slots; c++) {
        const uint8_t *w = k->w + (size_t)c * (size_t)high * 4;
        const float *v = y + k->at[c], *v2 = v + 2 * k->pitch[c];
        __m256 two = rows2(v, k->pitch[c]), more = two;
        if (high == 3)
            more = _mm256_castps128_ps256(_mm_loadu_ps(v2));
        if (high == 4)
            more = rows2(v2, k->pitch[c]);
        sums1_add(&s[0], w, two, more, high);
        if (columns == 2)
            sums1_add(&s[1], w + k->columns_w, two, more, high);
    }
    for (int i = 0; i < columns; i++)
        x[i] = unit * sums1_all(&s[i]);
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
INLINE void add_row(float *y, __m128 w, __m128 x)
{
    _mm_storeu_ps(y, _mm_fmadd_ps(w, x, _mm_loadu_ps(y)));
}
INLINE void put_rows2(float *v, size_t pitch, __m256 a)
{
    _mm_storeu_ps(v, _mm256_castps256_ps128(a));
    _mm_storeu_ps(v + pitch, _mm256_extractf128_ps(a, 1));
}
/* `columns`: one, or two whose windows lie at the same places; each bin is read and written once. */
INLINE void scatter1_columns(const struct walk *k, const float *x, float *y, int high, int columns)
{
    const __m256 x0 = _mm256_set1_ps(x[0]), x1 = _mm256_set1_ps(x[columns - 1]);
    for (int32_t c = 0; c < k->slots; c++) {
        const uint8_t *w = k->w + (size_t)c * (size_t)high * 4, *next = w + k->columns_w;
        size_t pitch = k->pitch[c];
        float *v = y + k->at[c];
        for (int r = 0; r + 2 <= high; r += 2, v += 2 * pitch) {
            __m256 sum = _mm256_fmadd_ps(weights8(w + 4 * r), x0, rows2(v, pitch));
            if (columns == 2)
                sum = _mm256_fmadd_ps(weights8(next + 4 * r), x1, sum);
            put_rows2(v, pitch, sum);
        }
        if (high == 3) {
            __m128 sum = _mm_fmadd_ps(weights4(w + 8), _mm256_castps256_ps128(x0), _mm_loadu_ps(v));
            if (columns == 2)
                sum = _mm_fmadd_ps(weights4(next + 8), _mm256_castps256_ps128(x1), sum);
            _mm_storeu_ps(v, sum);
        }
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

INLINE __m128 load2x2(const float *y, size_t pitch)
{
    __m128 first = _mm_castsi128_ps(_mm_loadu_si64(y)); /* of any alignment */
    return _mm_loadh_pi(first, (const void *)(y + pitch));
}
INLINE void adjoint1_2x2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                         const float *y, float *x)
{
    struct walk k;
    walk_from(&k, m, s, q0, 4, 1);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        __m128 a = _mm_setzero_ps(), b = a;
        for (int32_t c = 0; c < k.slots; c += 2) {
            const uint8_t *w = k.w + (size_t)c * 4;
            a = _mm_fmadd_ps(weights4(w), load2x2(y + k.at[c], k.pitch[c]), a);
            if (c + 1 == k.slots)
                break;
            b = _mm_fmadd_ps(weights4(w + 4), load2x2(y + k.at[c + 1], k.pitch[c + 1]), b);
        }
        x[q] = m->unit * fold4(_mm_add_ps(a, b));
    }
}
INLINE void scatter1_2x2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                         const float *x, float *y)
{
    struct walk k;
    walk_from(&k, m, s, q0, 4, 1);
    for (int32_t q = q0; q < q1; q++, walk_on(&k)) {
        __m128 xx = _mm_set1_ps(x[q]);
        for (int32_t c = 0; c < k.slots; c++) {
            float *v = y + k.at[c];
            __m128 sum = _mm_fmadd_ps(weights4(k.w + (size_t)c * 4), xx, load2x2(v, k.pitch[c]));
            _mm_storel_pi((void *)v, sum);
            _mm_storeh_pi((void *)(v + k.pitch[c]), sum);
        }
    }
}

/* ---- further windows ----------------------------------------------------------------------------- */

INLINE void adjoint4_more_of(const struct rec_windows *m, struct rec_slots s,
                             struct rec_more_run run, const float *y, float *x, int high, int wide)
{
    const __m128 unit = _mm_set1_ps(m->unit);
    struct walk p;
    walk_from(&p, m, (struct rec_slots){0, m->slots}, 0, 0, 4);
    for (const struct rec_more *k = run.at; k < run.end;) {
        __m256 a = _mm256_setzero_ps(), b = a, c = a, d = a;
        uint32_t q = k->column;
        for (; k < run.end && k->column == q; k++) {
            const float *v = y + (size_t)k->at * 4;
            size_t pitch = p.pitch[k->slot];
            if (!rec_more_is_of(k, s))
                continue;
            for (int r = 0; r < high; r += 2, v += 2 * pitch) {
                __m256 w = weights8(k->w + wide * r);
                a = _mm256_fmadd_ps(spread(w, 0), _mm256_loadu_ps(v), a);
                if (wide == 2) {
                    b = _mm256_fmadd_ps(spread(w, 1), _mm256_loadu_ps(v + pitch), b);
                    break;
                }
                b = _mm256_fmadd_ps(spread(w, 1), _mm256_loadu_ps(v + 8), b);
                if (r + 1 == high)
                    break;
                c = _mm256_fmadd_ps(spread(w, 2), _mm256_loadu_ps(v + pitch), c);
                d = _mm256_fmadd_ps(spread(w, 3), _mm256_loadu_ps(v + pitch + 8), d);
            }
        }
        a = _mm256_add_ps(_mm256_add_ps(a, b), _mm256_add_ps(c, d));
        float *to = x + (size_t)q * 4;
        _mm_store_ps(to, _mm_fmadd_ps(unit, fold(a), _mm_load_ps(to)));
    }
}
INLINE void scatter4_more_of(const struct rec_windows *m, struct rec_slots s,
                             struct rec_more_run run, const float *x, float *y, int high, int wide)
{
    struct walk p;
    walk_from(&p, m, (struct rec_slots){0, m->slots}, 0, 0, 4);
    for (const struct rec_more *k = run.at; k < run.end; k++) {
        __m256 xx = _mm256_broadcast_ps((const void *)(x + (size_t)k->column * 4));
        float *v = y + (size_t)k->at * 4;
        size_t pitch = p.pitch[k->slot];
        if (!rec_more_is_of(k, s))
            continue;
        for (int r = 0; r < high; r += 2, v += 2 * pitch) {
            __m256 w = weights8(k->w + wide * r);
            add_to(v, spread(w, 0), xx);
            if (wide == 2) {
                add_to(v + pitch, spread(w, 1), xx);
                break;
            }
            add_to(v + 8, spread(w, 1), xx);
            if (r + 1 == high)
                break;
            add_to(v + pitch, spread(w, 2), xx);
            add_to(v + pitch + 8, spread(w, 3), xx);
        }
    }
}
INLINE void adjoint1_more_of(const struct rec_windows *m, struct rec_slots s,
                             struct rec_more_run run, const float *y, float *x, int high, int wide)
{
    for (const struct rec_more *k = run.at; k < run.end;) {
        __m128 sum = _mm_setzero_ps();
        uint32_t q = k->column;
        for (; k < run.end && k->column == q; k++) {
            const float *v = y + k->at;
            size_t pitch = (size_t)m->pitch[k->slot];
            if (!rec_more_is_of(k, s))
                continue;
            for (int r = 0; r < high && wide == 4; r++, v += pitch)
                sum = _mm_fmadd_ps(weights4(k->w + 4 * r), _mm_loadu_ps(v), sum);
            if (wide == 2)
                sum = _mm_fmadd_ps(weights4(k->w), load2x2(v, pitch), sum);
        }
        x[q] += m->unit * fold4(sum);
    }
}
INLINE void scatter1_more_of(const struct rec_windows *m, struct rec_slots s,
                             struct rec_more_run run, const float *x, float *y, int high, int wide)
{
    for (const struct rec_more *k = run.at; k < run.end; k++) {
        const __m128 xx = _mm_set1_ps(x[k->column]);
        float *v = y + k->at;
        size_t pitch = (size_t)m->pitch[k->slot];
        if (!rec_more_is_of(k, s))
            continue;
        for (int r = 0; r < high && wide == 4; r++, v += pitch)
            add_row(v, weights4(k->w + 4 * r), xx);
        if (wide == 2) {
            __m128 sum = _mm_fmadd_ps(weights4(k->w), xx, load2x2(v, pitch));
            _mm_storel_pi((void *)v, sum);
            _mm_storeh_pi((void *)(v + pitch), sum);
        }
    }
}

/* ---- by shape ----------------------------------------------------------------------------------- */

REC_BY_SHAPE(adjoint1)
REC_BY_SHAPE(adjoint4)
REC_BY_SHAPE(scatter1)
REC_BY_SHAPE(scatter4)
REC_MORE_BY_SHAPE(adjoint1)
REC_MORE_BY_SHAPE(adjoint4)
REC_MORE_BY_SHAPE(scatter1)
REC_MORE_BY_SHAPE(scatter4)

void rec_adjoint1_avx2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                       const float *y, float *x)
{
    adjoint1(m, s, q0, q1, y, x);
}
void rec_scatter1_avx2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                       const float *x, float *y)
{
    scatter1(m, s, q0, q1, x, y);
}
void rec_adjoint4_avx2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                       const float *y, float *x)
{
    adjoint4(m, s, q0, q1, y, x);
}
void rec_windows_avx2(struct rec_kernels *k)
{
    k->adjoint1 = adjoint1;
    k->adjoint4 = adjoint4;
    k->scatter1 = scatter1;
    k->scatter4 = scatter4;
    k->adjoint1_more = adjoint1_more;
    k->adjoint4_more = adjoint4_more;
    k->scatter1_more = scatter1_more;
    k->scatter4_more = scatter4_more;
}
