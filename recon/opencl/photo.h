/* photo.h - photometry of a frame set on a device: carve/photo.h to the bit.
 *
 *     pixels -> b, weights, forced bins, blocks | noise, limits | silhouettes, clipped blacks mended
 * What is between the bars is decided on the host, from sums over blocks and bands that come down (27 kB a camera at
 * most).  So one round trip lies in the middle of it.
 * Ownership: a carver's.  Threads: one at a time.  After rec_cl_photo_new nothing allocates.  Private to recon. */
#ifndef REC_CL_PHOTO_H
#define REC_CL_PHOTO_H
#include "recon/carve/photo.h"
#include "recon/opencl/raw.h"
#include "recon/opencl/run.h"

typedef struct rec_cl_photo rec_cl_photo;

/* Pictures of a frame set, one camera's rows after the other's. */
struct rec_cl_pictures {
    struct rec_cl_buffer b;   /* lanes [rows] in: binned pixels, out: b */
    struct rec_cl_buffer w;   /* float [rows] out */
    struct rec_cl_buffer w4;  /* float4 [rows] out, of each channel; no buffer: not wanted */
    struct rec_cl_buffer lit; /* uchar [rows] out */
    struct {
        float *b, *w, *w4;
        uint8_t *lit;
    } here; /* where rec_cl_photo_apply brings copies of them; NULL: nowhere */
};

/* For a device that keeps denormal floats (rec_cl_about(cl)->denormals), and for pictures of the sizes and channels of
 * im [n]; their other members are not read.  raw_bytes: of all raw pictures of a set, at most; 0: none are raw.
 * maps [n]: bytes of their tables and maps, at most (rec_cl_maps_room); NULL: they have none.
 * Errors: PVX_ENOMEM, PVX_ENODEV. */
PVX_MUST_CHECK pvx_err rec_cl_photo_new(rec_cl *cl, const struct rec_photo_image *im, size_t n,
                                        size_t raw_bytes, const size_t *maps, rec_cl_photo **out,
                                        struct pvx_diag *d);
void rec_cl_photo_free(rec_cl_photo **p);

/* Background of camera c [bh][bw][cs] from the next set on; NULL: none.  Waits. */
void rec_cl_photo_background(rec_cl_photo *p, rec_cl_queue *q, size_t c, const float *bg);

/* A set begins: sends what is known of its pictures before their noise is. */
void rec_cl_photo_send(rec_cl_photo *p, rec_cl_queue *q, const struct rec_photo_image *im);

/* Raw pictures to binned pixels in to->b, for rec_cl_photo_apply.  raw [cameras]; those without a layout leave b as it
 * is.  The cameras' pixels are width / binning by height / binning bins.  Tables and maps go up when they are others than
 * in the set before.  false, and nothing is done: there is no room for so many bytes. */
bool rec_cl_photo_unpack(rec_cl_photo *p, rec_cl_queue *q, const struct rec_cl_raw *raw,
                         const struct rec_cl_pictures *to);

/* rec_photo_apply for the pictures that were given to ..._new, in `to` instead of im's img, weight, weight4 and lit,
 * which are not read.  A background is that of rec_cl_photo_background.  Fills im's stats and work.  Waits in its
 * middle and at its end; to->here is written at the end.  false: the device is lost, and what is here does not count. */
bool rec_cl_photo_apply(rec_cl_photo *p, rec_cl_queue *q, const struct rec_photo_image *im,
                        const struct rec_cl_pictures *to, pvx_pool *pool);

#endif
