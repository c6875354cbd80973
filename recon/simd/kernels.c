#include "recon/simd/kernels.h"

void rec_kernels_init(struct rec_kernels *k, enum pvx_cpu most)
{
    k->cpu = pvx_cpu() < most ? pvx_cpu() : most;
    rec_kernels_ref(k);
#if defined(__x86_64__)
    if (k->cpu >= PVX_CPU_AVX2) {
        rec_kernels_avx2(k);
        rec_windows_avx2(k);
    }
    if (k->cpu >= PVX_CPU_AVX512) {
        rec_kernels_avx512(k);
        rec_windows_avx512(k);
    }
#endif
}
