/* jpeg.h - JPEG pictures (motion JPEG) to grey or RGB pixels, with libjpeg-turbo.
 *
 * The frame header is read here first: only what cameras send is handed to the library (sequential,
 * Huffman-coded, 8 bits, one or three components) and only in the size that is expected, so that a
 * broken or hostile picture can neither ask for memory nor for time.  Every warning of the library
 * makes the picture bad - a cut or damaged one looks whole otherwise - but for up to 16 bytes left
 * over before the end-of-image marker, which many webcams send.  Pictures without Huffman tables get
 * the standard ones, as motion JPEG has it.
 * The pixels are gamma-coded R'G'B' of 8 bits (img.yuv says so; transfer.h): JFIF's matrix is that of
 * BT.601, full range; the library interpolates chroma and rounds R'G'B' once.
 * Memory: the picture's pixels and the decoder are allocated by cap_jpeg_new.  The library takes work
 * memory for each picture and gives it back (4:2:2 of 640x480: 8 blocks, 33 KB); it keeps none and
 * has no interface to be given one that reports errors without longjmp.
 * Threads: one call per decoder at a time. */
#ifndef CAP_JPEG_H
#define CAP_JPEG_H
#include "base/err.h"
#include "capture/pixel/image.h"

typedef struct cap_jpeg cap_jpeg;

/* For pictures of this size; PVX_EINVAL, PVX_ENOMEM.  Address space for 3 bytes per pixel, which costs
 * memory from the first picture on. */
PVX_MUST_CHECK pvx_err cap_jpeg_new(int32_t width, int32_t height, cap_jpeg **out);
void cap_jpeg_free(cap_jpeg **j);

/* From now on progressive pictures too, which files may be and cameras do not send: of at most 500 scans. */
void cap_jpeg_progressive(cap_jpeg *j);

/* What the frame header says, whatever its kind.  PVX_EFORMAT, PVX_ECORRUPT. */
PVX_MUST_CHECK pvx_err cap_jpeg_size(const void *bytes, size_t n, uint32_t *width, uint32_t *height,
                                     struct pvx_diag *d);

/* in: JPEG.  *out: CAP_GREY8 or CAP_RGB8, borrowed until the next call.
 * Errors: PVX_EFORMAT (not a JPEG), PVX_ERANGE (another size), PVX_EUNSUP (progressive, arithmetic,
 * 12-bit, CMYK ...), PVX_ECORRUPT (cut off or damaged); *out untouched. */
PVX_MUST_CHECK pvx_err cap_jpeg_decode(cap_jpeg *j, const struct cap_image *in,
                                       struct cap_image *out, struct pvx_diag *d);
#endif
