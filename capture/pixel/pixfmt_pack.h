/* pixfmt_pack.h - samples into raw rows of any integer format, for simulated cameras.  The inverse of pixfmt.h.
 * Threads: pure. */
#ifndef CAP_PIXFMT_PACK_H
#define CAP_PIXFMT_PACK_H
#include "capture/pixel/image.h"

/* samples [width][1 or 3], 0 .. 2^depth - 1, in the order RGB also for BGR8.  YUV: R'G'B' of 8 bits,
 * BT.601 limited range, a pair's mean chroma.  row: cap_pixfmt_row bytes, all written.  For JPEG and float
 * formats the call does nothing. */
void cap_pixfmt_pack_row(enum cap_pixfmt f, int32_t width, const uint16_t *samples, void *row);
#endif
