/* collect.h - the sum of the slabs' images, compiled into the including file.  It adds as many floats at once as that
 * file's instruction set has; the bits are the same with any. */
#ifndef REC_COLLECT_H
#define REC_COLLECT_H
#include "recon/matrix/subsys.h"
#include "recon/simd/wide.h"

REC_INLINE void rec_collect_lanes(const struct rec_subsys *a, struct rec_images *im,
                                  struct rec_block_range r, float *y, size_t cs, bool add)
{
    enum { MOST = REC_ROW_BLOCK * 4 / REC_WIDE };
    const size_t n = REC_ROW_BLOCK * cs / REC_WIDE;
    const rec_fw unit = rec_wide_splat(a->win.unit), zero = {0};
    for (int32_t b = r.at; b < r.end; b++) {
        size_t at = (size_t)a->block[b] * REC_ROW_BLOCK * cs;
        rec_fw sum[MOST] = {{0}};
        for (uint32_t slabs = a->slabs_of[b]; slabs != 0; slabs &= slabs - 1) {
            float *from = im->of[__builtin_ctz(slabs)] + at;
            for (size_t v = 0; v < n; v++) {
                sum[v] += rec_wide(from, v * REC_WIDE, REC_WIDE);
                rec_put_wide(from, v * REC_WIDE, REC_WIDE, zero);
            }
        }
        for (size_t v = 0; v < n; v++) {
            rec_fw all = unit * sum[v];
            if (add)
                all = rec_wide(y + at, v * REC_WIDE, REC_WIDE) + all;
            rec_put_wide(y + at, v * REC_WIDE, REC_WIDE, all);
        }
    }
}
/* y = the sum of the images, or y += the sum.  The images are 0 there afterwards. */
REC_INLINE void rec_collect_blocks(const struct rec_subsys *a, struct rec_images *im,
                                   struct rec_block_range r, float *y, bool add)
{
    a->cs == 4 ? rec_collect_lanes(a, im, r, y, 4, add) : rec_collect_lanes(a, im, r, y, 1, add);
}

#endif
