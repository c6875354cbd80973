/* jpeg.h - JPEG pictures (motion JPEG) to grey or RGB pixels, with libjpeg-turbo.
 *
 * This file reads the frame header first.  The library gets only what cameras send (sequential, Huffman-coded, 8
 * bits, one or three components), and only in the expected size.  So a broken or hostile picture can ask for neither
 * memory nor time.  Every warning of the library makes the picture bad, because an incomplete picture would look
 * whole otherwise.  Exception: up to 16 extra bytes before the end-of-image marker, which many webcams send.
 * Pictures without Huffman tables get the standard ones, as usual in motion JPEG.
 * The pixels are gamma-coded R'G'B' of 8 bits (img.yuv; transfer.h).  JFIF's matrix is that of BT.601, full range.
 * The library interpolates chroma and rounds R'G'B' once.
 * Memory: cap_jpeg_new allocates the picture's pixels and the decoder.  The library allocates work memory for each
 * picture and frees it (4:2:2 of 640x480: 8 blocks, 33 KB).  It has no interface for work memory of the caller that
 * reports errors without longjmp.
 * Threads: one call per decoder at a time. */
#ifndef CAP_JPEG_H
#define CAP_JPEG_H
#include "base/err.h"
#include "capture/pixel/image.h"

typedef struct cap_jpeg cap_jpeg;

/* For pictures of this size.  Errors: PVX_EINVAL, PVX_ENOMEM.  Reserves address space for 3 bytes per pixel, which
 * takes memory from the first picture on. */
PVX_MUST_CHECK pvx_err cap_jpeg_new(int32_t width, int32_t height, cap_jpeg **out);
void cap_jpeg_free(cap_jpeg **j);

/* From now on also decode progressive pictures of at most 500 scans.  Files may have them; cameras send none. */
void cap_jpeg_progressive(cap_jpeg *j);

/* Width and height from the frame header, of any kind of JPEG.  Errors: PVX_EFORMAT, PVX_ECORRUPT. */
PVX_MUST_CHECK pvx_err cap_jpeg_size(const void *bytes, size_t n, uint32_t *width, uint32_t *height,
                                     struct pvx_diag *d);

/* The tags of its EXIF data, a TIFF file in themselves; NULL: there are none. */
const void *cap_jpeg_exif(const void *bytes, size_t n, size_t *size);

/* in: JPEG.  *out: CAP_GREY8 or CAP_RGB8, borrowed until the next call.
 * Errors: PVX_EFORMAT (not a JPEG), PVX_ERANGE (another size), PVX_EUNSUP (progressive, arithmetic,
 * 12-bit, CMYK ...), PVX_ECORRUPT (cut off or damaged); *out untouched. */
PVX_MUST_CHECK pvx_err cap_jpeg_decode(cap_jpeg *j, const struct cap_image *in,
                                       struct cap_image *out, struct pvx_diag *d);
#endif
