#include "base/cpu.h"

#include <sched.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static _Atomic int chosen = -1; /* not chosen yet */

const char *pvx_cpu_name(enum pvx_cpu level)
{
    static const char *const names[] = {"ref", "avx2", "avx512"};
    return names[level];
}

enum pvx_cpu pvx_cpu_have(void)
{
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
        __builtin_cpu_supports("bmi2"))
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")
                   ? PVX_CPU_AVX512
                   : PVX_CPU_AVX2;
#endif
    return PVX_CPU_REF;
}

pvx_err pvx_cpu_use(const char *name, struct pvx_diag *d)
{
    enum pvx_cpu have = pvx_cpu_have(), level = have;
    if (name == NULL)
        name = getenv("PYROVOX_CPU");
    while (name != NULL && strcmp(name, pvx_cpu_name(level)) != 0)
        if (level-- == PVX_CPU_REF)
            return pvx_fail(d, PVX_EINVAL, "%s: no such kernels on this machine; it has ref%s%s",
                            name, have >= PVX_CPU_AVX2 ? ", avx2" : "",
                            have >= PVX_CPU_AVX512 ? ", avx512" : "");
    atomic_store(&chosen, (int)level);
    return PVX_OK;
}

enum pvx_cpu pvx_cpu(void)
{
    int level = atomic_load_explicit(&chosen, memory_order_relaxed);
    if (level < 0 && pvx_cpu_use(NULL, NULL) != PVX_OK)
        return pvx_cpu_have();
    return (enum pvx_cpu)atomic_load_explicit(&chosen, memory_order_relaxed);
}

unsigned pvx_cpu_count(void)
{
    cpu_set_t mine;
    if (sched_getaffinity(0, sizeof mine, &mine) == 0)
        return (unsigned)CPU_COUNT(&mine);
    long n = sysconf(_SC_NPROCESSORS_ONLN); /* more processors than fit into the set */
    return n < 1 ? 1 : (unsigned)n;
}
