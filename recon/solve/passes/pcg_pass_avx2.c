/* The loops of the default solver with AVX2: no gather of eight, but a voxel's four lanes widen to
 * double in one instruction. */
#if !defined(__AVX2__)
#error "pcg_pass_avx2.c needs -mavx2"
#endif
#define PASSES rec_pcg_passes_avx2
#include "recon/solve/passes/pcg_pass_impl.h"
