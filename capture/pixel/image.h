/* image.h - raw pixels as a camera or file gives them.
 *
 * Names are GenICam's (PFNC).  How samples lie in memory:
 *     8, 16            bytes; 16-bit words, host order (little endian)
 *     10, 12, 14       one 16-bit word per sample, the value in its low bits
 *     10p, 12p         a stream of bits, least significant first, samples not padded (PFNC)
 *     10Packed, 12Packed   GigE Vision 1: two samples in three bytes; high bits in bytes 0 and 2, the low ones
 *                      shared in byte 1
 *     10csi, 12csi     MIPI CSI-2 (V4L2 ...10P, ...12P): four samples' high bytes, then a byte of their low
 *                      bits; two and a byte
 *     YUV422_8         Y0 U Y1 V;  YUV422_8_UYVY  U Y0 V Y1
 *     JPEG             one JPEG picture (motion JPEG); size = its bytes, stride 0
 * Rows begin at a byte; img.stride >= cap_pixfmt_row. */
#ifndef CAP_IMAGE_H
#define CAP_IMAGE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* name = first two pixels of row 0 */
#define CAP_BAYER_FORMATS(depth) \
    CAP_BAYER_RG##depth, CAP_BAYER_GR##depth, CAP_BAYER_GB##depth, CAP_BAYER_BG##depth

enum cap_pixfmt {
    CAP_FMT_NONE,
    CAP_GREY8,
    CAP_GREY10,
    CAP_GREY12,
    CAP_GREY14,
    CAP_GREY16,
    CAP_GREY10P,
    CAP_GREY12P,
    CAP_GREY10PACKED,
    CAP_GREY12PACKED,
    CAP_GREY10CSI,
    CAP_GREY12CSI,
    CAP_RGB8,
    CAP_BGR8,
    CAP_RGB16,
    CAP_YUYV,
    CAP_UYVY,
    CAP_JPEG,
    CAP_BAYER_FORMATS(8),
    CAP_BAYER_FORMATS(10),
    CAP_BAYER_FORMATS(12),
    CAP_BAYER_FORMATS(14),
    CAP_BAYER_FORMATS(16),
    CAP_BAYER_FORMATS(10P),
    CAP_BAYER_FORMATS(12P),
    CAP_BAYER_FORMATS(10PACKED),
    CAP_BAYER_FORMATS(12PACKED),
    CAP_BAYER_FORMATS(10CSI),
    CAP_BAYER_FORMATS(12CSI),
    CAP_RGB10,
    CAP_RGB12,
    CAP_RGB14,
    CAP_GREY_F32,
    CAP_RGB_F32, /* linear already, 1.0 = full scale */
    CAP_N_FMT
};

/* How samples lie in memory. */
enum cap_layout {
    CAP_LAYOUT_NONE,
    CAP_LAYOUT_8,
    CAP_LAYOUT_16, /* also 10, 12, 14 in 16 */
    CAP_LAYOUT_P,
    CAP_LAYOUT_PACKED,
    CAP_LAYOUT_CSI,
    CAP_LAYOUT_YUV,
    CAP_LAYOUT_JPEG,
    CAP_LAYOUT_F32
};

/* How the samples of a gamma-coded image are coded: bits.  UVC cameras send 0: BT.601, limited range for YUV,
 * the transfer function of sRGB (transfer.h). */
enum cap_yuv {
    CAP_YUV_601 = 0,
    CAP_YUV_709 = 1,          /* matrix of BT.709 */
    CAP_YUV_FULL = 2,         /* 0..255 */
    CAP_YUV_TRANSFER_709 = 4, /* transfer function of BT.709 */
    CAP_YUV_CODED = 8         /* RGB or grey samples that came out of a JPEG: gamma-coded too */
};

struct cap_image {
    const void *data; /* borrowed */
    size_t size;      /* bytes present */
    int32_t width, height;
    ptrdiff_t stride; /* bytes from row to row */
    enum cap_pixfmt fmt;
    uint8_t yuv; /* enum cap_yuv */
};

const char *cap_pixfmt_name(enum cap_pixfmt f); /* "Mono8" "RGB8" "BayerRG12p" "JPEG" ... */
/* CAP_FMT_NONE when unknown.  Also accepts V4L2's names "YUYV" "UYVY" "GREY" "MJPG". */
enum cap_pixfmt cap_pixfmt_parse(const char *name);
#define CAP_PIXFMT_NAMES_MAX 600
/* All names in one line.  A Bayer format appears once for its four orders.  Returns the length. */
size_t cap_pixfmt_names(char *out, size_t size);
uint32_t cap_pixfmt_pfnc(enum cap_pixfmt f); /* GenICam's 32-bit code; 0 = none */
enum cap_pixfmt cap_pixfmt_from_pfnc(uint32_t code);
int cap_pixfmt_depth(enum cap_pixfmt f);    /* bits per sample: 8 10 12 14 16 32; 0 = NONE */
int cap_pixfmt_channels(enum cap_pixfmt f); /* 1 or 3: channels of the scene (Bayer: 3) */
enum cap_layout cap_pixfmt_layout(enum cap_pixfmt f);
/* Colour (0 R, 1 G, 2 B) of each pixel of a Bayer format's 2x2 cell, row by row; else NULL. */
const uint8_t *cap_pixfmt_bayer(enum cap_pixfmt f);
/* The format that differs from f in its depth only; NONE: there is none. */
enum cap_pixfmt cap_pixfmt_of_depth(enum cap_pixfmt f, int depth);
/* Whether an image of format `have` (by its file) can be read as format `want`.  A recorded sensor image is grey
 * in its file.  The file records neither the Bayer filter nor how many of 16 bits are used. */
bool cap_pixfmt_fits(enum cap_pixfmt have, enum cap_pixfmt want);
/* Bytes of a row of `width` pixels without padding; 0 for NONE and JPEG. */
size_t cap_pixfmt_row(enum cap_pixfmt f, int32_t width);
/* Largest size of an image in bytes: its rows.  JPEG: 3 bytes per pixel plus 4 KiB. */
size_t cap_pixfmt_image(enum cap_pixfmt f, int32_t width, int32_t height);
#endif
