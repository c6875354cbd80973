/* images.h - what a virtual camera sees: images from disk, ready in every format that it offers.
 *
 * UVC_MJPG  one JPEG; colour 4:2:2 as webcams send it, or grey
 * UVC_YUYV  ITU-R BT.601, 16..235/240 (what UVC's colour matching descriptor 4 stands for):
 *     Y = 16 + (65.481 R + 128.553 G + 24.966 B)/255
 *     U = 128 + (-37.797 R - 74.203 G + 112 B)/255,  V = 128 + (112 R - 93.786 G - 18.214 B)/255
 *     one U and V per two pixels, of their mean; rounded to nearest
 * UVC_GREY  the bytes of a grey image as they are; of a colour one 0.299 R + 0.587 G + 0.114 B
 * UVC_RGGB, UVC_RG16, UVC_RW10  what a sensor behind a Bayer filter sees, R first: of each pixel v, the
 *     byte of its own colour, as 8 bits (v), 16 little-endian (257 v) or 10 (4 v + v/64) in MIPI's packing:
 *     four bytes of high bits, one of the low bits
 * Sizes: that of the files, in multiples of 8, and half of it (means of 2 x 2). */
#ifndef VM_UVC_IMAGES_H
#define VM_UVC_IMAGES_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#define UVC_QUALITY     95 /* of JPEGs, unless said otherwise */
#define UVC_ALL_FORMATS ((1u << UVC_N_FORMATS) - 1)

/* index + 1 = bFormatIndex */
enum uvc_format { UVC_MJPG, UVC_YUYV, UVC_GREY, UVC_RGGB, UVC_RG16, UVC_RW10, UVC_N_FORMATS };
extern const unsigned uvc_bits[UVC_N_FORMATS]; /* of a pixel; of a JPEG's at most, by rule */
enum { UVC_N_SIZES = 2 };                      /* index + 1 = bFrameIndex */

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

/* All images that `name` stands for (sequence.h), 8-bit grey or RGB, one size.
 * formats: bits 1 << enum uvc_format, others stay empty.  quality: of the JPEGs, 1..100.  Owner: caller, uvc_images_free. */
PVX_MUST_CHECK pvx_err uvc_images_load(const char *name, unsigned formats, int quality,
                                       struct uvc_images *out, struct pvx_diag *d);
void uvc_images_free(struct uvc_images *m);
/* Largest image of a format and size without compression. */
size_t uvc_images_max(const struct uvc_images *m, enum uvc_format f, int size);
#endif
