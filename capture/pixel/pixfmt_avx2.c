/* pixfmt_avx2.c - the kernels for AVX2. */
#if !defined(__AVX2__)
#error "pixfmt_avx2.c needs -mavx2"
#endif
#include "capture/pixel/pixfmt_kernels.h"

void cap_pix_kernels_avx2(struct cap_pix_kernels *k)
{
    *k = pix_kernels;
}
