/* image.h - raw pixels as a camera or file gives them. */
#ifndef CAP_IMAGE_H
#define CAP_IMAGE_H
#include <stddef.h>
#include <stdint.h>

enum cap_pixfmt {
    CAP_FMT_NONE,
    CAP_GREY8,
    CAP_GREY16, /* 16-bit: host order, full scale 65535 */
    CAP_RGB8,
    CAP_RGB16,
    CAP_BAYER_RG8,
    CAP_BAYER_GR8,
    CAP_BAYER_GB8,
    CAP_BAYER_BG8, /* name = first two pixels of row 0 */
    CAP_GREY_F32,
    CAP_RGB_F32, /* linear already, 1.0 = full scale */
    CAP_N_FMT
};

struct cap_image {
    const void *data; /* borrowed */
    size_t size;      /* bytes that are really there */
    int32_t width, height;
    ptrdiff_t stride; /* bytes from row to row */
    enum cap_pixfmt fmt;
};

const char *cap_pixfmt_name(enum cap_pixfmt f); /* GenICam names: "Mono8" "RGB8" "BayerRG8" ... */
enum cap_pixfmt cap_pixfmt_parse(const char *name); /* CAP_FMT_NONE when unknown */
size_t cap_pixfmt_bytes(enum cap_pixfmt f);         /* bytes per pixel */
int cap_pixfmt_channels(enum cap_pixfmt f);         /* 1 or 3: channels of the scene (Bayer: 3) */
#endif
