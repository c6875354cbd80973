/* kernels_ref.c - the specification of the kernels in plain C; compiled everywhere. */
#include "recon/simd/simd.h"

static void scatter1(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                     const float *x, float *y)
{
    for (int32_t q = q0; q < q1; q++)
        for (uint32_t e = b->colptr[col[q]]; e < b->colptr[col[q] + 1]; e++)
            y[b->row[e]] += b->val[e] * x[q];
}

static void scatter4(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                     const float *x, float *y)
{
    for (int32_t q = q0; q < q1; q++)
        for (uint32_t e = b->colptr[col[q]]; e < b->colptr[col[q] + 1]; e++)
            for (int l = 0; l < 4; l++)
                y[(size_t)b->row[e] * 4 + l] += b->val[e] * x[(size_t)q * 4 + l];
}

static void gather1(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                    const float *y, float *x)
{
    for (int32_t q = q0; q < q1; q++) {
        double s = 0;
        for (uint32_t e = b->colptr[col[q]]; e < b->colptr[col[q] + 1]; e++)
            s += (double)b->val[e] * y[b->row[e]];
        x[q] = (float)(x[q] + s);
    }
}

static void gather4(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0, int32_t q1,
                    const float *y, float *x)
{
    for (int32_t q = q0; q < q1; q++) {
        double s[4] = {0};
        for (uint32_t e = b->colptr[col[q]]; e < b->colptr[col[q] + 1]; e++)
            for (int l = 0; l < 4; l++)
                s[l] += (double)b->val[e] * y[(size_t)b->row[e] * 4 + l];
        for (int l = 0; l < 4; l++)
            x[(size_t)q * 4 + l] = (float)(x[(size_t)q * 4 + l] + s[l]);
    }
}

void rec_kernels_ref(struct rec_kernels *k)
{
    *k = (struct rec_kernels){.name = "ref",
                              .scatter1 = scatter1,
                              .scatter4 = scatter4,
                              .gather1 = gather1,
                              .gather4 = gather4};
}
