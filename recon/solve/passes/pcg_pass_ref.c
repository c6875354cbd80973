/* The loops of the default solver for any CPU. */
#define PASSES rec_pcg_passes_base
#include "recon/solve/passes/pcg_pass_impl.h"

const struct rec_pcg_passes *rec_pcg_passes(const struct rec_kernels *k)
{
#if defined(__x86_64__)
    if (k->cpu >= PVX_CPU_AVX2)
        return &rec_pcg_passes_avx2;
#else
    (void)k;
#endif
    return &rec_pcg_passes_base;
}
