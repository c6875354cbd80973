/* pixfmt_base.c - the kernels for any processor. */
#include "capture/pixel/pixfmt_kernels.h"

void cap_pix_kernels_base(struct cap_pix_kernels *k)
{
    *k = pix_kernels;
}
