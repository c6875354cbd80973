/* pixfmt_kernels.h - the kernels of one instruction set; pixfmt_base.c and pixfmt_avx2.c include it.
 *
 * Most of them are plain loops.  The compiler vectorises them as wide as the including file's target allows.
 * Loops that it would not vectorise are written out under __AVX2__.  There is one plane per channel; a Bayer image
 * has one plane in all.  Planes are processed a piece of a row at a time, which fits the first-level cache with
 * the table. */
#ifndef CAP_PIXFMT_KERNELS_H
#define CAP_PIXFMT_KERNELS_H
#include "capture/pixel/pixfmt_bayer.h"
#include "capture/pixel/pixfmt_mosaic.h"
#include "capture/pixel/pixfmt_sums.h"

static void pix_floats(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    size_t row = (size_t)(j->img.width / j->binning), cs = j->nch == 3 ? 4 : 1;
    for (int32_t y = y0; y < y1; y++) {
        cap_pix_floats(j, y, y + 1, out);
        if (j->maps != NULL) /* while it is in the cache */
            pix_mapped(j, (size_t)y * row, row, out + (size_t)y * row * cs);
    }
}

static const struct cap_pix_kernels pix_kernels = {pix_sums, pix_bayer, pix_mosaic, pix_floats};
#endif
