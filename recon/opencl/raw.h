/* raw.h - pixels as a camera gives them, for a device that unpacks and bins them (kernels/unpack.cl).
 *
 * These are integers of linear light, in the layouts of capture/pixel/image.h, which has their bytes.  Others (gamma,
 * YUV, JPEG, floats, maps) are unpacked and binned by the processor, with the same bits (capture/pixel/pixfmt.h). */
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
    REC_CL_LAYOUT_CSI
};

struct rec_cl_raw {
    enum rec_cl_layout layout;
    const void *data;
    size_t bytes;          /* that are read */
    int32_t width, height; /* of the picture in pixels */
    size_t stride;         /* bytes from row to row */
    int depth;             /* bits of a sample */
    int binning;
    int samples;         /* of a pixel, 1 or 3 */
    bool grey;           /* one channel; a Bayer picture has three */
    bool swapped;        /* blue comes first */
    bool rays;           /* Bayer pixels as they are: binning 1, three channels */
    const uint8_t *cell; /* Bayer: colours of the 2x2 pixels, row by row; or NULL */
    uint32_t clip;       /* a sample is saturated from here on */
    float most;          /* value of saturated channels */
};

#endif
