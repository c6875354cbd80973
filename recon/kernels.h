/* kernels.h - inner loops with one readable reference and ISA variants (STYLE 2.6).
 *
 * rec_kernels_init fills every slot with the reference (plain C, double accumulators where it
 * reduces), then overwrites with what the CPU and `mask` allow.  Kernels run on one camera block.
 *   scatter: y[row_e][:] += val_e * x[q][:]   for the entries e of columns col[q], q in [q0,q1)
 *   gather:  x[q][:]     += sum_e val_e * y[row_e][:]
 * x [n][cs], y [bw*bh][cs] of this camera; col [n]; cs = 1 or 4. */
#ifndef REC_KERNELS_H
#define REC_KERNELS_H
#include <stdint.h>
#include "recon/sysmat.h"

enum { REC_CPU_AVX2 = 1, REC_CPU_AVX512 = 2, REC_CPU_NEON = 4, REC_CPU_ALL = ~0 };

typedef void (*rec_scatter_fn)(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0,
                               int32_t q1, const float *x, float *y);
typedef void (*rec_gather_fn)(const struct rec_sysmat_block *b, const int32_t *col, int32_t q0,
                              int32_t q1, const float *y, float *x);

struct rec_kernels {
    const char *name; /* "ref", "avx2", ... */
    rec_scatter_fn scatter1, scatter4;
    rec_gather_fn gather1, gather4;
};

/* Flags of this CPU. */
unsigned rec_cpu_flags(void);
/* Fill the table for cpu & mask; the environment variable PYROVOX_CPU (ref|avx2) narrows it. */
void rec_kernels_init(struct rec_kernels *k, unsigned mask);

#endif
