/* parts.h - shared by the files of this room: regions of pictures. */
#ifndef REC_LIGHT_PARTS_H
#define REC_LIGHT_PARTS_H
#include <math.h>
#include <stdbool.h>

#include "base/median.h"
#include "recon/geom/spd.h"
#include "recon/light/light.h"

#define REC_REGIONS 8 /* of a picture, each way */

static inline size_t rec_light_pixels(const struct rec_light_picture *p)
{
    return (size_t)p->width * (size_t)p->height;
}

/* Colour of a sample; 0 of grey. */
static inline int rec_light_colour(const struct rec_light_picture *p, size_t pixel, int k)
{
    size_t w = (size_t)p->width;
    return p->cell != NULL ? p->cell[pixel / w % 2 * 2 + pixel % w % 2] : k;
}

/* Region of a pixel, 0..63. */
static inline int rec_light_region(const struct rec_light_picture *p, size_t pixel)
{
    size_t w = (size_t)p->width, x = pixel % w, y = pixel / w;
    return (int)(y * REC_REGIONS / (size_t)p->height) * REC_REGIONS + (int)(x * REC_REGIONS / w);
}

/* Mean of each region's finite samples of a colour (-1: all); NAN where there is none. */
void rec_light_regions(const struct rec_light_picture *p, const float *v, int colour,
                       double out[REC_REGIONS * REC_REGIONS]);
/* Median of up to 65536 finite samples spread over the picture. */
double rec_light_median(const float *v, size_t n, double *scratch);
#define REC_LIGHT_SCRATCH 65536
#endif
