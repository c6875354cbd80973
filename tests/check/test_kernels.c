/* Every kernel slot of every instruction set against the reference (STYLE 2.6).
 * Bound: |isa - ref| <= g sum|v||x| + (n+2) 2^-149, g = (n+2)u/(1-(n+2)u), u = 2^-24 (Higham,
 * Accuracy and Stability of Numerical Algorithms, ch. 3), once for the variant and once for the
 * reference's rounding to float. */
#include "../t.h"

#include <float.h>
#include <stdbool.h>
#include <sys/mman.h>
#include <unistd.h>

#include "recon/kernels.h"

static const int sizes[] = {0, 1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 100, 1027};
#define N_SIZES ((int)(sizeof sizes / sizeof *sizes))
#define INPUTS 300

/* A buffer that ends at a page that can not be touched. */
static void *guarded(size_t bytes)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE), room = (bytes + page - 1) / page * page;
    char *p = mmap(NULL, room + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED || mprotect(p + room, page, PROT_NONE) != 0)
        exit(2);
    return p + room - bytes;
}

static float value(bool denormal)
{
    return (float)(denormal ? t_uniform(-1, 1) * 1e-39 : t_uniform(-2, 2));
}

static void compare(rec_gather_fn ref, rec_gather_fn isa, int cs, bool denormal)
{
    size_t total = 0;
    for (int i = 0; i < N_SIZES; i++)
        total += (size_t)sizes[i];
    uint32_t ptr[N_SIZES + 1] = {0};
    struct rec_entry *entry = guarded(total * sizeof *entry);
    float *in = guarded((size_t)INPUTS * (size_t)cs * sizeof *in);
    float *want = guarded((size_t)N_SIZES * (size_t)cs * sizeof *want);
    float *got = guarded((size_t)N_SIZES * (size_t)cs * sizeof *got);
    for (int i = 0; i < N_SIZES; i++)
        ptr[i + 1] = ptr[i] + (uint32_t)sizes[i];
    for (size_t e = 0; e < total; e++)
        entry[e] = (struct rec_entry){(uint32_t)(t_rand() % INPUTS), value(denormal)};
    entry[total - 1].idx = INPUTS - 1; /* up to the guard page */
    for (int i = 0; i < INPUTS * cs; i++)
        in[i] = value(false);
    struct rec_gather g = {.ptr = ptr, .entry = entry};
    for (int i = 0; i < N_SIZES * cs; i++)
        want[i] = got[i] = 77; /* outputs are set, not added to */
    ref(&g, 0, N_SIZES, in, want);
    isa(&g, 0, 3, in, got); /* in two pieces */
    isa(&g, 3, N_SIZES, in, got);
    for (int i = 0; i < N_SIZES; i++)
        for (int l = 0; l < cs; l++) {
            double sum = 0, n = sizes[i], u = 0x1p-24, bound = (n + 2) * u / (1 - (n + 2) * u);
            for (uint32_t e = ptr[i]; e < ptr[i + 1]; e++)
                sum += fabs((double)entry[e].val * in[(int)entry[e].idx * cs + l]);
            T_NEAR(got[i * cs + l], want[i * cs + l], 2 * (bound * sum + (n + 2) * 0x1p-149));
        }
}

static void every_slot_against_the_reference(void)
{
    static const unsigned masks[] = {REC_CPU_AVX2, REC_CPU_AVX512, REC_CPU_NEON, REC_CPU_ALL};
    struct rec_kernels ref, k;
    unsetenv("PYROVOX_CPU");
    rec_kernels_init(&ref, 0);
    T_EQ_S(ref.name, "ref");
    for (size_t m = 0; m < sizeof masks / sizeof *masks; m++) {
        rec_kernels_init(&k, masks[m]);
        for (int round = 0; round < 20; round++) {
            compare(ref.gather1, k.gather1, 1, round % 2 != 0);
            compare(ref.gather4, k.gather4, 4, round % 2 != 0);
        }
    }
}

static void environment_narrows(void)
{
    struct rec_kernels k;
    setenv("PYROVOX_CPU", "ref", 1);
    rec_kernels_init(&k, REC_CPU_ALL);
    T_EQ_S(k.name, "ref");
    setenv("PYROVOX_CPU", "avx2", 1);
    rec_kernels_init(&k, REC_CPU_ALL);
    T_EQ_S(k.name, rec_cpu_flags() & REC_CPU_AVX2 ? "avx2" : "ref");
    unsetenv("PYROVOX_CPU");
}

int main(void)
{
    T_RUN(every_slot_against_the_reference);
    T_RUN(environment_narrows);
    return t_done();
}
