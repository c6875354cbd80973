/* kernels.h - inner loops with one readable reference and ISA variants (STYLE 2.6).
 *
 * rec_kernels_init fills every slot with the reference (plain C, double accumulators), then
 * overwrites with what the CPU and `mask` allow.
 *   gather: out[i][:] = sum_e e.val * in[e.idx][:],  e in [ptr[i], ptr[i+1]),  i in [i0, i1)
 * in, out [..][cs]; cs = 1 (any alignment) or 4 (16-byte aligned).  No over-read.
 * Both products of the restricted system are this one loop over packed entries (subsys.h). */
#ifndef REC_KERNELS_H
#define REC_KERNELS_H
#include <stdint.h>

enum { REC_CPU_AVX2 = 1, REC_CPU_AVX512 = 2, REC_CPU_NEON = 4, REC_CPU_ALL = ~0 };

struct rec_entry {
    uint32_t idx;
    float val;
};
struct rec_gather {
    uint32_t *ptr;           /* [outputs + 1], ascending */
    struct rec_entry *entry; /* [ptr[outputs]] */
};

/* The same in half the bytes, for the products that a solver repeats: an entry is one word, the index
 * in its low `bits`, above it the value in units of `unit`.  Indices are < 2^bits; 16 <= bits <= 26. */
struct rec_packed {
    uint32_t *ptr;   /* [outputs + 1], ascending */
    uint32_t *entry; /* [ptr[outputs]] */
    uint32_t bits;
    float unit;
};
static inline uint32_t rec_packed_index(const struct rec_packed *g, uint32_t e)
{
    return g->entry[e] & ((1u << g->bits) - 1);
}
static inline float rec_packed_value(const struct rec_packed *g, uint32_t e)
{
    return g->unit * (float)(g->entry[e] >> g->bits);
}

typedef void (*rec_packed_fn)(const struct rec_packed *g, int32_t i0, int32_t i1, const float *in,
                              float *out);
typedef void (*rec_gather_fn)(const struct rec_gather *g, int32_t i0, int32_t i1, const float *in,
                              float *out);

struct rec_pcg_passes; /* pcg_pass.h */

struct rec_kernels {
    const char *name; /* "ref", "avx2", ... */
    rec_gather_fn gather1, gather4;
    rec_packed_fn packed1, packed4;   /* the same sums over packed entries */
    const struct rec_pcg_passes *pcg; /* the other loops of the default solver */
};

/* Flags of this CPU. */
unsigned rec_cpu_flags(void);
/* Fill the table for cpu & mask; the environment variable PYROVOX_CPU (ref|avx2|avx512) narrows it. */
void rec_kernels_init(struct rec_kernels *k, unsigned mask);

#endif
