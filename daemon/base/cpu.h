/* cpu.h - the instruction sets that the inner loops may use.
 *
 * A table of loops is filled for a level: first every slot with the reference in plain C, then each instruction set
 * up to the level overwrites the slots for which it has a loop.  A slot without a faster loop stays the reference.
 * Threads: any; pvx_cpu_use only at the program's start. */
#ifndef PVX_CPU_H
#define PVX_CPU_H
#include "base/err.h"

/* Each level includes those before it. */
enum pvx_cpu {
    PVX_CPU_REF,
    PVX_CPU_AVX2,   /* with FMA and BMI2 */
    PVX_CPU_AVX512, /* F and VL */
    PVX_CPU_BEST = PVX_CPU_AVX512
};

/* "ref", "avx2", "avx512" */
const char *pvx_cpu_name(enum pvx_cpu level);
/* What this processor can do. */
enum pvx_cpu pvx_cpu_have(void);
/* Limit to a level by its name.  NULL: the environment variable PYROVOX_CPU, else the best level.  PVX_EINVAL: this
 * processor has no such level (diag lists those it has). */
PVX_MUST_CHECK pvx_err pvx_cpu_use(const char *name, struct pvx_diag *d);
/* The level to use.  Without a call of pvx_cpu_use, a valid PYROVOX_CPU counts. */
enum pvx_cpu pvx_cpu(void);

/* Number of processors that the calling thread may run on, at least one.  taskset, mpirun, Slurm or CPUAffinity=
 * may limit it. */
unsigned pvx_cpu_count(void);
#endif
