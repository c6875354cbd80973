/* depth.h - how many bits the samples of 16-bit words have, as far as pictures show it.
 *
 * Cameras of 10 to 14 bits put their samples into the low bits of 16, and most files do not say so.  Programs that keep
 * them as signed numbers end at 15.  Where the greatest of many samples is exactly 2^bits - 1, the camera is saturated
 * there.  Cameras of 9 bits are not known, and dim pictures often end near 511. */
#ifndef CAP_DEPTH_H
#define CAP_DEPTH_H
#include "capture/pixel/image.h"

/* The greatest sample so far, and the number of samples that have it. */
struct cap_depth {
    unsigned top;
    uint64_t n;
};

/* Look at every `step`-th of the image's rows [y0, y1).  Other layouts than words: nothing. */
void cap_depth_look(struct cap_depth *d, const struct cap_image *img, int32_t y0, int32_t y1,
                    int32_t step);
void cap_depth_join(struct cap_depth *d, const struct cap_depth *more);
/* 10 to 15: `least` samples or more are at the end of so many bits, and none is above.  0: else. */
int cap_depth_bits(const struct cap_depth *d, uint64_t least);
/* The remedy in words, of images read as fmt; option: what comes before the name of a format. */
const char *cap_depth_remedy(enum cap_pixfmt fmt, int bits, const char *option, char room[120]);
#endif
