#include "recon/carve/photo_mosaic.h"

struct rec_grain rec_grain_bayer(int32_t binning)
{
    if (binning == 1)
        return (struct rec_grain){4, {1.5f, 2.23f, 1.5f, 1}, {2.94f, 4.39f, 2.94f, 1}};
    float b = (float)binning, a = 8 * b - 6, near = 9 * a / (24 * b - 6),
          wide = 49 * a / (56 * b - 6);
    return (struct rec_grain){2, {near, 3, near, 1}, {wide, 7, wide, 1}};
}
