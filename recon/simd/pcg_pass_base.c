/* The loops of the default solver for any CPU. */
#define PASSES rec_pcg_passes_base
#include "recon/simd/pcg_pass_impl.h"
