/* film.h - write pictures into one file: an animated PNG, or a video by ffmpeg. */
#ifndef FILM_H
#define FILM_H
#include "daemon/cli/pictures/look.h"

struct film;

enum film_kind { FILM_NONE, FILM_APNG, FILM_VIDEO };
/* The kind by the end of the name. */
enum film_kind film_kind(const char *path);

/* fps 1..100.  `look` gives the display values; it is copied, with .depth 8.  Errors name the file.  Owner: caller,
 * until film_end or film_drop. */
PVX_MUST_CHECK pvx_err film_new(const char *path, int fps, const struct look *look,
                                struct film **out, struct pvx_diag *d);
/* pix [h][w][nch], nch 1 or 3, linear.  All pictures of a film must have the shape of the first one.
 * PVX_EFORMAT: this one has another shape. */
PVX_MUST_CHECK pvx_err film_add(struct film *f, const float *pix, int32_t w, int32_t h, int nch,
                                struct pvx_diag *d);
/* Finish the file.  Without a picture there is no file.  Frees *f, after an error too. */
PVX_MUST_CHECK pvx_err film_end(struct film **f, struct pvx_diag *d);
void film_drop(struct film **f); /* stop without a file */

#endif
