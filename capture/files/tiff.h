/* tiff.h - pages of a TIFF or BigTIFF file; inside capture.
 *
 * A page is one full picture.  Thumbnails, smaller copies and masks (NewSubfileType 1 and 4, SubfileType 2) are no pages.
 * The module reads samples by libtiff.  What a tag changes in them is obeyed or refused: README.md has the list.
 * Files in which one folder of tags stands for several pictures are refused: ImageJ's stacks above 4 GB, MetaMorph's.
 * Threads: pure.  Every offset is checked against the size of the file. */
#ifndef CAP_TIFF_H
#define CAP_TIFF_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "capture/pixel/image.h"

/* The bytes of a file: in memory, or, where p is NULL, behind a descriptor. */
struct cap_bytes {
    const void *p;
    uint64_t n;
    int fd;
};

/* Copies `size` bytes from `at` on; false: they are not all there. */
bool cap_bytes_get(const struct cap_bytes *b, uint64_t at, void *to, size_t size);

/* Refuses a picture that its EXIF data say is to be turned (`bytes`: a TIFF file of tags).  PVX_EUNSUP. */
PVX_MUST_CHECK pvx_err cap_exif_upright(const void *bytes, size_t n, const char *name,
                                        struct pvx_diag *d);

/* Counts the pages (NULL: looks no further than needed).  at != NULL: also where the tags of page `page` lie.  `name`: the file's name in messages.
 * Errors: PVX_ECORRUPT, PVX_EUNSUP, PVX_ERANGE (no such page). */
PVX_MUST_CHECK pvx_err cap_tiff_pages(const struct cap_bytes *b, const char *name, uint32_t page,
                                      uint32_t *pages, uint64_t *at, struct pvx_diag *d);

#define CAP_TIFF_VERSION 1

/* The module of libtiff (pyrovox-tiff.so), loaded on first use: base/module.h says where it is looked for. */
struct cap_tiff {
    int version;
    /* The page whose tags lie at `at`.  Integers of 1, 2, 4 and 8 bits become 8 bits, others up to 16 become 16, and
     * those of more a float: 2^bits - 1 is full scale.  Floats come as they are.  The caller owns *mem, free();
     * out->data is in it. */
    pvx_err (*load)(const struct cap_bytes *b, const char *name, uint64_t at, struct cap_image *out,
                    void **mem, struct pvx_diag *d);
};

const struct cap_tiff *cap_tiff_module(void);
#endif
