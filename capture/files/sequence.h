/* sequence.h - finds the numbered image files that a name means.
 *
 *   DIR/cam0/%06d.png   printf pattern, one %d or %0Nd in the last part: all files that match
 *   DIR/cam0            folder: all images in it          DIR/cam0/a*.png     glob (* ? [)
 *   DIR/flame.png       one image
 * Except with a pattern, a file's number is the last run of digits in its name without extension
 * (0 for one image without digits).  Missing numbers are gaps, not errors.  Names that begin with a dot are passed
 * over.  A file without a number, or of an unknown type, is counted and left out. */
#ifndef CAP_SEQUENCE_H
#define CAP_SEQUENCE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

struct cap_sequence {
    size_t n;
    struct cap_sequence_item {
        int64_t number;
        char *path;
    } * item; /* [n] by number, n >= 1 */
    size_t
        odd; /* the first item whose name differs from that of item 0 in more than digits and extension; 0: none */
    size_t unnumbered, unknown;
    char *first_unnumbered, *first_unknown; /* NULL: none */
};

/* Owner: caller, cap_sequence_free(), after an error too.  Errors: PVX_EINVAL (pattern; two files of one number; names
 * whose other digits give another order), PVX_ERANGE (a number beyond INT64_MAX), PVX_ENOENT (no such folder, or no
 * image fits), PVX_EPERM, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_sequence_find(const char *name, struct cap_sequence *out,
                                         struct pvx_diag *d);
void cap_sequence_free(struct cap_sequence *s);
/* By its extension: .npy .png .tif .tiff .jpg .jpeg, in any case. */
bool cap_is_image(const char *path);
/* .jpg .jpeg, in any case. */
bool cap_is_jpeg(const char *path);
/* .tif .tiff, in any case: such a file may have several pages. */
bool cap_is_stack(const char *path);
/* .mp4 .avi .mkv .mov .cine .mraw, in any case. */
bool cap_is_video(const char *path);
bool cap_is_cine(const char *path);
/* Of a high-speed camera: .cine .mraw, and .cih .cihx, which stand for the .mraw beside them. */
bool cap_is_raw(const char *path);
/* Neither of these nor, by its name, a file that people and programs leave beside pictures (notes, tables, Thumbs.db):
 * it may be a picture of another type. */
bool cap_is_unknown(const char *path);
#define CAP_IMAGES ".npy .png .tif .tiff .jpg .jpeg"
#define CAP_VIDEOS ".mp4 .avi .mkv .mov .cine .mraw"
#endif
