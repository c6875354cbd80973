/* picture.h - what the head of a PNG, TIFF or JPEG file says, before a library reads the rest; inside capture.
 *
 * Only these three are handed on, whatever a file is called, and only within two bounds, so that a small file can
 * ask for little memory: CAP_SIDE_MAX pixels each way, as a camera of a rig, and CAP_PER_BYTE_MAX pixels for each byte
 * of the file.  (Of one colour, a PNG of 1 bit has 8256 of them, a JPEG 1024.)
 * Threads: pure.  Every offset is checked against the bytes that are there. */
#ifndef CAP_PICTURE_H
#define CAP_PICTURE_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#define CAP_SIDE_MAX     16384
#define CAP_PER_BYTE_MAX 16384

enum cap_picture_kind { CAP_FILE_PNG, CAP_FILE_TIFF, CAP_FILE_JPEG };

struct cap_picture {
    enum cap_picture_kind kind;
    uint32_t width, height;
};

/* Whether a picture of that size may come out of a file of `len` bytes.  PVX_ECORRUPT, PVX_ERANGE. */
PVX_MUST_CHECK pvx_err cap_picture_fits(uint32_t width, uint32_t height, uint64_t len,
                                        const char *name, struct pvx_diag *d);

/* Pixels as the head of a PNG says, 24 bytes; 0x0: it is none, or does not say. */
void cap_picture_png(const void *bytes, size_t len, uint32_t *width, uint32_t *height);

/* `name` is what messages call the file.  PVX_EFORMAT (none of the three), PVX_ECORRUPT, PVX_ERANGE. */
PVX_MUST_CHECK pvx_err cap_picture_head(const void *bytes, size_t len, const char *name,
                                        struct cap_picture *out, struct pvx_diag *d);
#endif
