/* film.h - the module of films (lib/pyrovox/pyrovox-films.so), which holds all that is linked with FFmpeg's libraries.
 *
 * film.c loads it on first use.  It reads films (film_read.c, film_pixels.c).  It calls base and the rooms of capture
 * in the program that loads it.  imgio.h says what the calls mean. */
#ifndef CAP_FILM_H
#define CAP_FILM_H
#include "capture/files/imgio.h"

#define CAP_FILMS_VERSION 2

struct film; /* opaque */

struct cap_films {
    int version; /* CAP_FILMS_VERSION */
    /* bytes: the size of the file, for the bound of picture.h */
    pvx_err (*open)(const char *path, uint64_t bytes, struct film **out,
                    struct cap_video_info *info, struct pvx_diag *d);
    pvx_err (*next)(struct film *f, struct cap_image *img, int64_t *t_ns, struct pvx_diag *d);
    pvx_err (*times)(const char *path, uint64_t bytes, int64_t **t_ns, size_t *n,
                     struct pvx_diag *d);
    void (*close)(struct film *f); /* NULL: nothing */
};

const struct cap_films *cap_films_module(void);
#endif
