/* kernels_ref.c - the specification of the kernels in plain C; compiled everywhere. */
#include <stddef.h>

#include "recon/simd/kernels.h"

static void kernels_ref_gather1(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in,
                                float *out)
{
    for (int32_t i = i0; i < i1; i++) {
        double s = 0;
        for (uint32_t e = g->ptr[i]; e < g->ptr[i + 1]; e++)
            s += (double)g->entry[e].val * in[g->entry[e].idx];
        out[i] = (float)s;
    }
}

static void kernels_ref_gather4(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in,
                                float *out)
{
    for (int32_t i = i0; i < i1; i++) {
        double s[4] = {0};
        for (uint32_t e = g->ptr[i]; e < g->ptr[i + 1]; e++)
            for (int l = 0; l < 4; l++)
                s[l] += (double)g->entry[e].val * in[(size_t)g->entry[e].idx * 4 + l];
        for (int l = 0; l < 4; l++)
            out[(size_t)i * 4 + l] = (float)s[l];
    }
}

/* One window, at bin y: sum of w y, or y += w x. */
static inline void gather_window(const struct rec_windows *m, int32_t slot, const uint8_t *w,
                                 const float *y, int cs, double sum[4])
{
    for (int32_t r = 0; r < m->high; r++)
        for (int32_t k = 0; k < m->wide; k++, w++)
            for (int l = 0; l < cs; l++)
                sum[l] += (double)*w * y[(r * m->pitch[slot] + k) * cs + l];
}
static inline void scatter_window(const struct rec_windows *m, int32_t slot, const uint8_t *w,
                                  const float *x, int cs, float *y)
{
    for (int32_t r = 0; r < m->high; r++)
        for (int32_t k = 0; k < m->wide; k++, w++)
            for (int l = 0; l < cs; l++)
                y[(r * m->pitch[slot] + k) * cs + l] += (float)*w * x[l];
}

static inline void kernels_ref_adjoint(const struct rec_windows *m, struct rec_slots s, int32_t q0,
                                       int32_t q1, const float *y, float *x, int cs)
{
    size_t size = rec_window_size(m);
    for (int32_t q = q0; q < q1; q++) {
        double sum[4] = {0};
        for (int32_t c = s.s0; c < s.s1; c++) {
            size_t at = (size_t)q * (size_t)m->slots + (size_t)c;
            gather_window(m, c, m->w + at * size, y + (size_t)m->at[at] * (size_t)cs, cs, sum);
        }
        for (int l = 0; l < cs; l++)
            x[q * cs + l] = (float)(m->unit * sum[l]);
    }
}
static inline void kernels_ref_scatter(const struct rec_windows *m, struct rec_slots s, int32_t q0,
                                       int32_t q1, const float *x, float *y, int cs)
{
    size_t size = rec_window_size(m);
    for (int32_t q = q0; q < q1; q++) {
        for (int32_t c = s.s0; c < s.s1; c++) {
            size_t at = (size_t)q * (size_t)m->slots + (size_t)c;
            scatter_window(m, c, m->w + at * size, x + (size_t)q * (size_t)cs, cs,
                           y + (size_t)m->at[at] * (size_t)cs);
        }
    }
}

/* A column's further windows follow one another; their sum is added to the column once. */
static inline void kernels_ref_adjoint_more(const struct rec_windows *m, struct rec_slots s,
                                            struct rec_more_run run, const float *y, float *x,
                                            int cs)
{
    for (const struct rec_more *k = run.at; k < run.end;) {
        double sum[4] = {0};
        uint32_t q = k->column;
        for (; k < run.end && k->column == q; k++)
            if (rec_more_is_of(k, s))
                gather_window(m, (int32_t)k->slot, k->w, y + (size_t)k->at * (size_t)cs, cs, sum);
        for (int l = 0; l < cs; l++) {
            float *to = &x[(size_t)q * (size_t)cs + (size_t)l];
            *to = (float)(*to + m->unit * sum[l]);
        }
    }
}
static inline void kernels_ref_scatter_more(const struct rec_windows *m, struct rec_slots s,
                                            struct rec_more_run run, const float *x, float *y,
                                            int cs)
{
    for (const struct rec_more *k = run.at; k < run.end; k++)
        if (rec_more_is_of(k, s))
            scatter_window(m, (int32_t)k->slot, k->w, x + (size_t)k->column * (size_t)cs, cs,
                           y + (size_t)k->at * (size_t)cs);
}

#define WITH_CHANNELS(cs)                                                                         \
    static void kernels_ref_adjoint##cs(const struct rec_windows *m, struct rec_slots s,          \
                                        int32_t q0, int32_t q1, const float *y, float *x)         \
    {                                                                                             \
        kernels_ref_adjoint(m, s, q0, q1, y, x, cs);                                              \
    }                                                                                             \
    static void kernels_ref_scatter##cs(const struct rec_windows *m, struct rec_slots s,          \
                                        int32_t q0, int32_t q1, const float *x, float *y)         \
    {                                                                                             \
        kernels_ref_scatter(m, s, q0, q1, x, y, cs);                                              \
    }                                                                                             \
    static void kernels_ref_adjoint##cs##_more(const struct rec_windows *m, struct rec_slots s,   \
                                               struct rec_more_run run, const float *y, float *x) \
    {                                                                                             \
        kernels_ref_adjoint_more(m, s, run, y, x, cs);                                            \
    }                                                                                             \
    static void kernels_ref_scatter##cs##_more(const struct rec_windows *m, struct rec_slots s,   \
                                               struct rec_more_run run, const float *x, float *y) \
    {                                                                                             \
        kernels_ref_scatter_more(m, s, run, x, y, cs);                                            \
    }
WITH_CHANNELS(1)
WITH_CHANNELS(4)

void rec_kernels_ref(struct rec_kernels *k)
{
    k->gather1 = kernels_ref_gather1;
    k->gather4 = kernels_ref_gather4;
    k->adjoint1 = kernels_ref_adjoint1;
    k->adjoint4 = kernels_ref_adjoint4;
    k->scatter1 = kernels_ref_scatter1;
    k->scatter4 = kernels_ref_scatter4;
    k->adjoint1_more = kernels_ref_adjoint1_more;
    k->adjoint4_more = kernels_ref_adjoint4_more;
    k->scatter1_more = kernels_ref_scatter1_more;
    k->scatter4_more = kernels_ref_scatter4_more;
}
