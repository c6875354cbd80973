/* photo_impl.h - work areas of photometry on a device.  Private to photo.c and unpack.c. */
#ifndef REC_CL_PHOTO_IMPL_H
#define REC_CL_PHOTO_IMPL_H
#include "recon/carve/bands.h"
#include "recon/opencl/kernels/shared.h"
#include "recon/opencl/photo.h"

struct rec_cl_photo {
    rec_cl *cl;
    size_t cameras, bands, rows, cs;
    size_t row0[REC_MAX_CAMERAS + 1];
    bool background[REC_MAX_CAMERAS];
    struct rec_bands of;
    /* on the device */
    struct rec_cl_buffer shot, limits, band, at, block; /* at: int2 [bands] camera, first row */
    struct rec_cl_buffer back, plane;                   /* lanes [rows] */
    struct rec_cl_buffer raw, clean;                    /* uchar [rows] */
    struct rec_cl_buffer inverse, noisy;
    /* of unpack.c */
    struct rec_cl_buffer raw_picture, bytes, maps;
    size_t maps0[REC_MAX_CAMERAS + 1];       /* words: room for each camera's */
    struct rec_cl_maps has[REC_MAX_CAMERAS]; /* that are there */
    /* their copies here */
    struct rec_cl_raw_picture raws[REC_MAX_CAMERAS];
    struct rec_cl_picture shots[REC_MAX_CAMERAS];
    struct rec_cl_picture_limits limit[REC_MAX_CAMERAS];
    struct rec_cl_picture_block *blocks; /* [cameras][REC_PHOTO_BLOCKS] */
    struct rec_cl_picture_band sums[];   /* [bands] */
};

#endif
