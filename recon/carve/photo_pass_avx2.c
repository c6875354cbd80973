/* The loops of photometry with AVX2: eight floats at a time. */
#if !defined(__AVX2__)
#error "photo_pass_avx2.c needs -mavx2"
#endif
#define PASSES rec_photo_passes_avx2
#include "recon/carve/photo_pass_impl.h"
