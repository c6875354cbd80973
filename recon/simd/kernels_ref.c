/* kernels_ref.c - the specification of the kernels in plain C; compiled everywhere. */
#include <stddef.h>

#include "recon/solve/passes/pcg_pass.h"
#include "recon/simd/simd.h"

static void gather1(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in, float *out)
{
    for (int32_t i = i0; i < i1; i++) {
        double s = 0;
        for (uint32_t e = g->ptr[i]; e < g->ptr[i + 1]; e++)
            s += (double)g->entry[e].val * in[g->entry[e].idx];
        out[i] = (float)s;
    }
}

static void gather4(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in, float *out)
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

static void packed1(const struct rec_packed *g, int32_t i0, int32_t i1, const float *in, float *out)
{
    for (int32_t i = i0; i < i1; i++) {
        double s = 0;
        for (uint32_t e = g->ptr[i]; e < g->ptr[i + 1]; e++)
            s += (double)(g->entry[e] >> g->bits) * in[rec_packed_index(g, e)];
        out[i] = (float)(g->unit * s);
    }
}

static void packed4(const struct rec_packed *g, int32_t i0, int32_t i1, const float *in, float *out)
{
    for (int32_t i = i0; i < i1; i++) {
        double s[4] = {0};
        for (uint32_t e = g->ptr[i]; e < g->ptr[i + 1]; e++)
            for (int l = 0; l < 4; l++)
                s[l] += (double)(g->entry[e] >> g->bits) *
                        in[(size_t)rec_packed_index(g, e) * 4 + (size_t)l];
        for (int l = 0; l < 4; l++)
            out[(size_t)i * 4 + (size_t)l] = (float)(g->unit * s[l]);
    }
}

void rec_kernels_ref(struct rec_kernels *k)
{
    *k = (struct rec_kernels){.name = "ref",
                              .gather1 = gather1,
                              .gather4 = gather4,
                              .packed1 = packed1,
                              .packed4 = packed4,
                              .pcg = &rec_pcg_passes_base};
}
