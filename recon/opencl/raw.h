/* raw.h - pixels as a camera gives them, for a device that unpacks and bins them (kernels/unpack.cl).
 *
 * These are integers in the layouts of capture/pixel/image.h, which has their bytes.  Floats are binned by the processor,
 * and JPEG pictures are decoded there.  What becomes of the samples is in capture/pixel/recipe.h, to the bit. */
#ifndef REC_CL_RAW_H
#define REC_CL_RAW_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum rec_cl_layout {
    REC_CL_LAYOUT_NONE, /* the camera's pixels are not raw, or not there */
    REC_CL_LAYOUT_8,
    REC_CL_LAYOUT_16,
    REC_CL_LAYOUT_P,
    REC_CL_LAYOUT_PACKED,
    REC_CL_LAYOUT_CSI,
    REC_CL_LAYOUT_YUV
};

/* A camera's tables and maps.  They stay on the device as long as `number` and `table` do. */
struct rec_cl_maps {
    const uint32_t *table; /* [2^depth] light of a sample; NULL: the sample itself */
    float unit;            /* factor of the means of bins */
    uint64_t number;       /* of the maps; 0: none, and the rest is NULL */
    const uint32_t *word;  /* [planes][plane], a plane begins with those of the bins; or NULL */
    size_t plane, planes;  /* planes: 1 or 3 */
    /* A bit for each pixel, row by row, the least one first.  1: it is left out.  NULL: none is. */
    const uint8_t *mask;
    const float *matrix; /* [9], of three channels; or NULL */
};

struct rec_cl_raw {
    enum rec_cl_layout layout;
    const void *data;
    size_t bytes;          /* that are read */
    int32_t width, height; /* of the picture in pixels */
    size_t stride;         /* bytes from row to row */
    int depth;             /* bits of a sample, 8 to 16 */
    int binning;
    int samples;         /* of a pixel, 1 or 3 */
    bool grey;           /* one channel; a Bayer picture has three */
    bool swapped;        /* blue comes first; of YUV: colour comes first */
    bool rays;           /* Bayer pixels as they are: binning 1, three channels */
    const uint8_t *cell; /* Bayer: colours of the 2x2 pixels, row by row; or NULL */
    uint32_t clip;       /* a sample is saturated from here on, at most 2^depth - 1 */
    float most;          /* value of saturated channels */
    float full;          /* full scale of what is summed up */
    struct {
        float y, cb[3], cr[3], at[3]; /* (0) of recipe.h */
    } yuv;
    struct rec_cl_maps maps;
};

#define REC_CL_TABLE_BYTES ((size_t)4 << 16) /* of the largest table */

/* Bytes of the tables and maps of a camera of so many pixels and bins, at most. */
static inline size_t rec_cl_maps_room(size_t pixels, size_t bins, int nch)
{
    return REC_CL_TABLE_BYTES + 4 * (bins * (nch == 3 ? 3 : 1) + pixels / 32 + 1);
}

#endif
