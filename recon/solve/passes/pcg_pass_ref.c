/* The loops of the default solver for any CPU, and their table. */
#define PASSES rec_pcg_passes_ref
#include "recon/solve/passes/pcg_pass_impl.h"

void rec_pcg_passes_init(struct rec_pcg_passes *p, enum pvx_cpu cpu)
{
    rec_pcg_passes_ref(p);
#if defined(__x86_64__)
    if (cpu >= PVX_CPU_AVX2)
        rec_pcg_passes_avx2(p);
#else
    (void)cpu;
#endif
}
