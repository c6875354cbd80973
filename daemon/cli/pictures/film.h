/* film.h - write pictures into one file with the program ffmpeg: an animated PNG (.apng), or a video (.mp4 .mov .mkv
 * by H.264, .webm by VP9).
 *
 * The program is used instead of the library, because users have its encoders and know them.  It reads raw pictures
 * from a socket and writes PATH.tmp.PID.EXT, which is renamed at the end.  Ctrl-C of a terminal does not reach it:
 * film_end then makes a whole film of the pictures so far.
 * Threads: one at a time. */
#ifndef FILM_H
#define FILM_H
#include <stdbool.h>
#include "daemon/cli/pictures/look.h"

struct film;

/* Whether path ends as the name of a film. */
bool film_named(const char *path);

/* fps 1..100.  `look` gives the display values; it is copied, with .depth 8.  Errors name the file.  Owner: caller,
 * until film_end or film_drop. */
PVX_MUST_CHECK pvx_err film_new(const char *path, int fps, const struct look *look,
                                struct film **out, struct pvx_diag *d);
/* pix [h][w][nch], nch 1 or 3, linear.  All pictures of a film must have the shape of the first one.
 * PVX_EFORMAT: this one has another shape.  PVX_ENOENT: ffmpeg is not installed, names the package. */
PVX_MUST_CHECK pvx_err film_add(struct film *f, const float *pix, int32_t w, int32_t h, int nch,
                                struct pvx_diag *d);
/* Finish the file.  Without a picture there is no file.  Frees *f, after an error too; then there is no file. */
PVX_MUST_CHECK pvx_err film_end(struct film **f, struct pvx_diag *d);
void film_drop(struct film **f); /* stop without a file */

#endif
