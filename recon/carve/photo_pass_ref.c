/* The loops of photometry for any CPU, and their table. */
#define PASSES rec_photo_passes_ref
#include "recon/carve/photo_pass_impl.h"

void rec_photo_passes_init(struct rec_photo_passes *p, enum pvx_cpu cpu)
{
    rec_photo_passes_ref(p);
#if defined(__x86_64__)
    if (cpu >= PVX_CPU_AVX2)
        rec_photo_passes_avx2(p);
#else
    (void)cpu;
#endif
}
