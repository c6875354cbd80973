/* png.h - PNG files by libpng; inside capture.
 *
 * Samples come as they are stored: 1, 2 and 4 bits of grey become 8, a map of colours becomes RGB, transparency is left
 * out.  gAMA, sRGB, iCCP, cICP and sBIT change nothing.  Animations and turned pictures (eXIf) are refused.
 * Threads: pure. */
#ifndef CAP_PNG_H
#define CAP_PNG_H
#include <stddef.h>
#include "base/err.h"
#include "capture/pixel/image.h"

/* The caller owns *mem, free(); out->data is in it.  `name`: the file's name in messages.
 * Errors: PVX_ECORRUPT, PVX_EUNSUP, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_png_load(const void *bytes, size_t n, const char *name,
                                    struct cap_image *out, void **mem, struct pvx_diag *d);

/* Grey or RGB of 8 or 16 bits; atomic write. */
PVX_MUST_CHECK pvx_err cap_png_save(const char *path, const struct cap_image *img,
                                    struct pvx_diag *d);
#endif
