/* test_gather.c - every gather kernel of every instruction set against a sum in double, with the bound
 *     |kernel - exact| <= g sum|v||x| + (n+2) 2^-149,  g = (n+2)u/(1-(n+2)u),  u = 2^-24
 * (N. J. Higham, Accuracy and Stability of Numerical Algorithms, ch. 3; the last term is underflow),
 * and nothing read or written beside the arrays (guard pages behind them). */
#include "../t.h"

#include "recon/simd/kernels.h"
#include "tests/lib/guarded.h"
#include "tests/lib/hard_values.h"

static const int32_t sizes[] = {0, 1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 64, 127, 1027};
#define N_SIZES ((int32_t)(sizeof sizes / sizeof sizes[0]))
#define IN_ROWS 509

/* Rows of all sizes. */
static void check_table(const struct rec_kernels *k, enum data d, int cs)
{
    uint32_t *ptr = guarded((size_t)(N_SIZES + 1) * 4);
    float *in = guarded((size_t)IN_ROWS * (size_t)cs * 4);
    float *out = guarded((size_t)N_SIZES * (size_t)cs * 4);
    for (int32_t i = 0; i < N_SIZES; i++)
        ptr[i + 1] = ptr[i] + (uint32_t)sizes[i];
    uint32_t total = ptr[N_SIZES];
    struct rec_gather g = {.ptr = ptr, .entry = guarded(total * sizeof(struct rec_entry))};
    for (uint32_t e = 0; e < total; e++) {
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
            for (uint32_t e = ptr[i]; e < ptr[i + 1]; e++) {
                double p = (double)g.entry[e].val * in[g.entry[e].idx * (uint32_t)cs + (uint32_t)l];
                exact += p;
                mag += fabs(p);
            }
            double bound = n * u / (1 - n * u) * mag + n * 0x1p-149;
            double got = out[i * cs + l];
            T_CHECK_(fabs(got - exact) <= bound, "%s cs %d n %d: %.9g, want %.9g +- %.3g",
                     pvx_cpu_name(k->cpu), cs, sizes[i], got, exact, bound);
        }
}

T_CASE(gather_within_the_derived_bound)
{
    for (int level = PVX_CPU_REF; level <= (int)pvx_cpu_have(); level++) {
        struct rec_kernels k;
        rec_kernels_init(&k, (enum pvx_cpu)level);
        T_EQ_I(k.cpu, level);
        for (int d = 0; d < N_DATA; d++)
            for (int round = 0; round < 3; round++) {
                check_table(&k, (enum data)d, 1);
                check_table(&k, (enum data)d, 4);
            }
    }
}

T_CASE(one_narrowing_for_all)
{
    struct rec_kernels k;
    struct pvx_diag d = {""};
    for (int level = PVX_CPU_REF; level <= PVX_CPU_BEST; level++) {
        int have = level <= (int)pvx_cpu_have();
        if (!have)
            printf("  not on this processor, so not tested here: %s\n",
                   pvx_cpu_name((enum pvx_cpu)level));
        T_EQ_I(pvx_cpu_use(pvx_cpu_name((enum pvx_cpu)level), NULL), have ? PVX_OK : PVX_EINVAL);
        rec_kernels_init(&k, PVX_CPU_BEST);
        T_EQ_I(k.cpu, have ? level : (int)pvx_cpu_have());
    }
    setenv("PYROVOX_CPU", "ref", 1);
    T_EQ_I(pvx_cpu_use(NULL, NULL), PVX_OK);
    T_EQ_I(pvx_cpu(), PVX_CPU_REF);
    setenv("PYROVOX_CPU", "avx", 1); /* by its whole name */
    T_EQ_I(pvx_cpu_use(NULL, &d), PVX_EINVAL);
    T_OK(strstr(d.text, "it has ref") != NULL);
    T_EQ_I(pvx_cpu(), PVX_CPU_REF); /* stays */
    unsetenv("PYROVOX_CPU");
    T_EQ_I(pvx_cpu_use(NULL, NULL), PVX_OK);
    T_EQ_I(pvx_cpu(), pvx_cpu_have());
}

int main(void)
{
    unsetenv("PYROVOX_CPU");
    return t_run();
}
