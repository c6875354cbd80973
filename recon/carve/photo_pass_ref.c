/* The loops of photometry for any CPU. */
#define PASSES rec_photo_passes_base
#include "recon/carve/photo_pass_impl.h"
