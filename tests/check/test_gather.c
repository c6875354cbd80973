/* test_gather.c - every gather kernel of every instruction set against a sum in double, with the bound
 *     |kernel - exact| <= g sum|v||x| + (n+2) 2^-149,  g = (n+2)u/(1-(n+2)u),  u = 2^-24
 * (N. J. Higham, Accuracy and Stability of Numerical Algorithms, ch. 3; the last term is underflow),
 * and nothing read or written beside the arrays (guard pages behind them). */
#include "../t.h"

#include <sys/mman.h>
#include <unistd.h>

#include "recon/kernels.h"

static const int32_t sizes[] = {0, 1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 64, 127, 1027};
#define N_SIZES ((int32_t)(sizeof sizes / sizeof sizes[0]))
#define IN_ROWS 509

/* `bytes` that end where an inaccessible page begins; aligned to 16 when bytes are a multiple of it. */
static void *guarded(size_t bytes)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE), room = (bytes + page - 1) / page * page;
    unsigned char *p =
        mmap(NULL, room + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED || mprotect(p + room, page, PROT_NONE) != 0)
        abort();
    return p + room - bytes;
}

enum data { RANDOM, DENORMAL, HUGE_RANGE, N_DATA };
static float value(enum data d)
{
    double v = t_uniform(-1, 1);
    if (d == DENORMAL)
        v *= 0x1p-140;
    if (d == HUGE_RANGE)
        v *= exp2(t_uniform(-40, 40));
    return (float)v;
}

static void check_table(const struct rec_kernels *k, enum data d, int cs)
{
    size_t total = 0;
    for (int32_t i = 0; i < N_SIZES; i++)
        total += (size_t)sizes[i];
    struct rec_gather g = {.ptr = guarded((size_t)(N_SIZES + 1) * 4),
                           .entry = guarded(total * sizeof(struct rec_entry))};
    float *in = guarded((size_t)IN_ROWS * (size_t)cs * 4),
          *out = guarded((size_t)N_SIZES * (size_t)cs * 4);
    g.ptr[0] = 0;
    for (int32_t i = 0; i < N_SIZES; i++)
        g.ptr[i + 1] = g.ptr[i] + (uint32_t)sizes[i];
    for (size_t e = 0; e < total; e++) {
        g.entry[e].idx = (uint32_t)(t_rand() % IN_ROWS);
        g.entry[e].val = value(d);
    }
    g.entry[total - 1].idx = IN_ROWS - 1; /* the last row lies at the guard page */
    for (size_t i = 0; i < (size_t)IN_ROWS * (size_t)cs; i++)
        in[i] = value(d);
    for (size_t i = 0; i < (size_t)N_SIZES * (size_t)cs; i++)
        out[i] = 77;
    /* in two pieces: outputs outside [i0,i1) stay */
    rec_gather_fn fn = cs == 4 ? k->gather4 : k->gather1;
    fn(&g, 0, 5, in, out);
    T_OK(out[5 * cs] == 77);
    fn(&g, 5, N_SIZES, in, out);
    for (int32_t i = 0; i < N_SIZES; i++)
        for (int l = 0; l < cs; l++) {
            double exact = 0, mag = 0, n = sizes[i] + 2, u = 0x1p-24;
            for (uint32_t e = g.ptr[i]; e < g.ptr[i + 1]; e++) {
                double p = (double)g.entry[e].val * in[g.entry[e].idx * (uint32_t)cs + (uint32_t)l];
                exact += p;
                mag += fabs(p);
            }
            double bound = n * u / (1 - n * u) * mag + n * 0x1p-149;
            double got = out[i * cs + l];
            T_CHECK_(fabs(got - exact) <= bound, "%s cs %d n %d: %.9g, want %.9g +- %.3g", k->name,
                     cs, sizes[i], got, exact, bound);
        }
}

/* The packed form: values are small integers, exact as floats, times `unit` at the end: one more
 * rounding. */
static void check_packed(const struct rec_kernels *k, enum data d, int cs, uint32_t bits)
{
    size_t total = 0;
    for (int32_t i = 0; i < N_SIZES; i++)
        total += (size_t)sizes[i];
    struct rec_packed g = {.ptr = guarded((size_t)(N_SIZES + 1) * 4),
                           .entry = guarded(total * 4),
                           .bits = bits,
                           .unit = 0.0173f};
    float *in = guarded((size_t)IN_ROWS * (size_t)cs * 4),
          *out = guarded((size_t)N_SIZES * (size_t)cs * 4);
    g.ptr[0] = 0;
    for (int32_t i = 0; i < N_SIZES; i++)
        g.ptr[i + 1] = g.ptr[i] + (uint32_t)sizes[i];
    for (size_t e = 0; e < total; e++)
        g.entry[e] = (uint32_t)(t_rand() % IN_ROWS) | (uint32_t)t_rand() << bits;
    g.entry[total - 1] = (IN_ROWS - 1) | UINT32_MAX << bits;
    for (size_t i = 0; i < (size_t)IN_ROWS * (size_t)cs; i++)
        in[i] = value(d);
    for (size_t i = 0; i < (size_t)N_SIZES * (size_t)cs; i++)
        out[i] = 77;
    rec_packed_fn fn = cs == 4 ? k->packed4 : k->packed1;
    fn(&g, 0, 5, in, out);
    T_OK(out[5 * cs] == 77);
    fn(&g, 5, N_SIZES, in, out);
    for (int32_t i = 0; i < N_SIZES; i++)
        for (int l = 0; l < cs; l++) {
            double exact = 0, mag = 0, n = sizes[i] + 3, u = 0x1p-24;
            for (uint32_t e = g.ptr[i]; e < g.ptr[i + 1]; e++) {
                uint32_t at = g.entry[e] & ((1u << bits) - 1);
                double p =
                    (double)g.unit * (g.entry[e] >> bits) * in[at * (uint32_t)cs + (uint32_t)l];
                exact += p;
                mag += fabs(p);
                T_OK(rec_packed_index(&g, e) == at);
                T_OK(rec_packed_value(&g, e) == g.unit * (float)(g.entry[e] >> bits));
            }
            double bound = n * u / (1 - n * u) * mag + n * 0x1p-149;
            double got = out[i * cs + l];
            T_CHECK_(fabs(got - exact) <= bound, "%s packed %u cs %d n %d: %.9g, want %.9g +- %.3g",
                     k->name, bits, cs, sizes[i], got, exact, bound);
        }
}

static void gather_within_the_derived_bound(void)
{
    const unsigned masks[] = {0, REC_CPU_AVX2, (unsigned)REC_CPU_ALL};
    for (size_t m = 0; m < sizeof masks / sizeof masks[0]; m++) {
        struct rec_kernels k;
        rec_kernels_init(&k, masks[m]);
        for (int d = 0; d < N_DATA; d++)
            for (int round = 0; round < 3; round++) {
                check_table(&k, (enum data)d, 1);
                check_table(&k, (enum data)d, 4);
                for (uint32_t bits = 16; bits <= 26; bits += 5) {
                    check_packed(&k, (enum data)d, 1, bits);
                    check_packed(&k, (enum data)d, 4, bits);
                }
            }
    }
}

static void mask_zero_is_the_reference(void)
{
    struct rec_kernels k;
    rec_kernels_init(&k, 0);
    T_EQ_S(k.name, "ref");
    rec_kernels_init(&k, (unsigned)REC_CPU_ALL);
    if (rec_cpu_flags() & REC_CPU_AVX2)
        T_OK(strcmp(k.name, "ref") != 0);
}

static void environment_narrows(void)
{
    struct rec_kernels k;
    setenv("PYROVOX_CPU", "ref", 1);
    rec_kernels_init(&k, (unsigned)REC_CPU_ALL);
    T_EQ_S(k.name, "ref");
    setenv("PYROVOX_CPU", "avx2", 1);
    rec_kernels_init(&k, (unsigned)REC_CPU_ALL);
    T_EQ_S(k.name, rec_cpu_flags() & REC_CPU_AVX2 ? "avx2" : "ref");
    unsetenv("PYROVOX_CPU");
}

int main(void)
{
    unsetenv("PYROVOX_CPU");
    T_RUN(mask_zero_is_the_reference);
    T_RUN(gather_within_the_derived_bound);
    T_RUN(environment_narrows);
    return t_done();
}
