#include "recon/kernels.h"

#include <stdlib.h>
#include <string.h>

#include "recon/simd/simd.h"

unsigned rec_cpu_flags(void)
{
    unsigned flags = 0;
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
        __builtin_cpu_supports("bmi2"))
        flags |= REC_CPU_AVX2;
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl"))
        flags |= REC_CPU_AVX512;
#elif defined(__aarch64__)
    flags |= REC_CPU_NEON;
#endif
    return flags;
}

void rec_kernels_init(struct rec_kernels *k, unsigned mask)
{
    rec_kernels_ref(k);
    const char *env = getenv("PYROVOX_CPU");
    if (env != NULL && strcmp(env, "ref") == 0)
        mask = 0;
    else if (env != NULL && strcmp(env, "avx2") == 0)
        mask &= REC_CPU_AVX2;
    else if (env != NULL && strcmp(env, "avx512") == 0)
        mask &= REC_CPU_AVX2 | REC_CPU_AVX512;
    unsigned have = rec_cpu_flags() & mask;
#if defined(__x86_64__)
    if (have & REC_CPU_AVX2)
        rec_kernels_avx2(k);
    if (have & REC_CPU_AVX2 && have & REC_CPU_AVX512)
        rec_kernels_avx512(k);
#else
    (void)have;
#endif
}
