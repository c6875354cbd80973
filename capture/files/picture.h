/* picture.h - the type and size of a PNG, TIFF or JPEG file before a library reads the rest; inside capture.
 *
 * Only these three types are passed on, whatever the name of the file.  Two bounds keep a small file from asking for
 * much memory: CAP_SIDE_MAX pixels each way, as for a camera of a rig, and CAP_PER_BYTE_MAX pixels per byte of the
 * file.  (A picture of one colour has 8256 per byte as a PNG of 1 bit, and 1024 as a JPEG.)
 * Threads: pure.  Every offset is checked against the size of the file. */
#ifndef CAP_PICTURE_H
#define CAP_PICTURE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "capture/pixel/image.h"

#define CAP_SIDE_MAX     16384
#define CAP_PER_BYTE_MAX 16384

enum cap_picture_kind { CAP_FILE_PNG, CAP_FILE_JPEG };

struct cap_picture {
    enum cap_picture_kind kind;
    uint32_t width, height;
};

/* Whether a picture of that size may come out of a file of `len` bytes.  PVX_ECORRUPT, PVX_ERANGE. */
PVX_MUST_CHECK pvx_err cap_picture_fits(uint32_t width, uint32_t height, uint64_t len,
                                        const char *name, struct pvx_diag *d);

/* TIFF or BigTIFF, by its first 4 bytes. */
bool cap_picture_is_tiff(const void *head, size_t n);

/* Width and height from the head of a PNG, 24 bytes; 0x0: it is not a PNG, or has no size there. */
void cap_picture_png(const void *bytes, size_t len, uint32_t *width, uint32_t *height);

/* Memory for a picture, free(): 1 or 3 channels of 8 or 16 bits, or floats (32).  NULL: no memory. */
void *cap_picture_make(uint32_t width, uint32_t height, int channels, int depth, const char *name,
                       struct cap_image *out, struct pvx_diag *d);

/* Of a PNG or JPEG; the pages of a TIFF have sizes of their own (tiff.h).  `name`: the file's name in messages.
 * PVX_EFORMAT (none of the three types), PVX_ECORRUPT, PVX_ERANGE. */
PVX_MUST_CHECK pvx_err cap_picture_head(const void *bytes, size_t len, const char *name,
                                        struct cap_picture *out, struct pvx_diag *d);
#endif
