/* kernels.h - inner loops with one readable reference (plain C, double accumulators) and variants for
 * instruction sets (base/cpu.h).
 *
 *   gather: out[i][:] = sum_e e.val * in[e.idx][:],  e in [ptr[i], ptr[i+1]),  i in [i0, i1)
 * in, out [..][cs]; cs = 1 (any alignment) or 4 (16-byte aligned).  No over-read.
 *   adjoint, scatter: both products with a matrix of windows (windows.h).  Scattered sums are float, also
 *   in the reference. */
#ifndef REC_KERNELS_H
#define REC_KERNELS_H
#include <stdint.h>
#include "base/cpu.h"
#include "recon/simd/windows.h"

struct rec_entry {
    uint32_t idx;
    float val;
};
struct rec_gather {
    uint32_t *ptr;           /* [outputs + 1], ascending */
    struct rec_entry *entry; /* [ptr[outputs]] */
};

typedef void (*rec_gather_fn)(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in,
                              float *out);

struct rec_kernels {
    rec_gather_fn gather1, gather4;
    rec_windows_adjoint_fn adjoint1, adjoint4;
    rec_windows_scatter_fn scatter1, scatter4;
    rec_windows_more_fn adjoint1_more, adjoint4_more, scatter1_more, scatter4_more;
    enum pvx_cpu cpu; /* instruction set that other loops may use too */
};

/* Fill the table for pvx_cpu(), but for no better set than `most`. */
void rec_kernels_init(struct rec_kernels *k, enum pvx_cpu most);
/* One function of each file, which overwrites the slots that the file implements. */
void rec_kernels_ref(struct rec_kernels *k);
#if defined(__x86_64__)
void rec_kernels_avx2(struct rec_kernels *k);
void rec_kernels_avx512(struct rec_kernels *k);
void rec_windows_avx2(struct rec_kernels *k);
void rec_windows_avx512(struct rec_kernels *k);
void rec_adjoint1_avx2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                       const float *y, float *x); /* these for the shapes where they are fastest */
void rec_scatter1_avx2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                       const float *x, float *y);
void rec_adjoint4_avx2(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1,
                       const float *y, float *x);
#endif

#endif
