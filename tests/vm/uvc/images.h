/* images.h - what a virtual camera sees: images from disk, ready in every format that it offers.
 *
 * UVC_MJPG  one JPEG; colour 4:2:2 as webcams send it, or grey
 * UVC_YUYV  ITU-R BT.601, 16..235/240 (what UVC's colour matching descriptor 4 stands for):
 *     Y = 16 + (65.481 R + 128.553 G + 24.966 B)/255
 *     U = 128 + (-37.797 R - 74.203 G + 112 B)/255,  V = 128 + (112 R - 93.786 G - 18.214 B)/255
 *     one U and V per two pixels, of their mean; rounded to nearest
 * UVC_GREY  the bytes of a grey image as they are; of a colour one 0.299 R + 0.587 G + 0.114 B
 * Sizes: that of the files, and half of it (means of 2 x 2). */
#ifndef VM_UVC_IMAGES_H
#define VM_UVC_IMAGES_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#define UVC_QUALITY 95 /* of JPEGs, unless said otherwise */

enum uvc_format { UVC_MJPG, UVC_YUYV, UVC_GREY, UVC_N_FORMATS }; /* index + 1 = bFormatIndex */
enum { UVC_N_SIZES = 2 };                                        /* index + 1 = bFrameIndex */

struct uvc_images {
    size_t n; /* instants */
    struct uvc_size {
        int32_t width, height;
    } size[UVC_N_SIZES];
    struct uvc_bytes {
        uint8_t *data;
        size_t n;
    } * frame[UVC_N_FORMATS][UVC_N_SIZES]; /* [n] each */
};

/* All images that `name` stands for (sequence.h), 8-bit grey or RGB, one size, even.  quality: of
 * the JPEGs, 1..100.  Owner: caller, uvc_images_free. */
PVX_MUST_CHECK pvx_err uvc_images_load(const char *name, int quality, struct uvc_images *out,
                                       struct pvx_diag *d);
void uvc_images_free(struct uvc_images *m);
/* Largest image of a format and size without compression. */
size_t uvc_images_max(const struct uvc_images *m, enum uvc_format f, int size);
#endif
