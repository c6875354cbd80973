/* film.h - the module of films (lib/pyrovox/pyrovox-films.so), which holds all that is linked with FFmpeg's libraries.
 *
 * film.c loads it on first use.  It reads films (film_read.c, film_pixels.c) and writes animated PNGs
 * (film_apng.c).  It calls base and the rooms of capture in the program that loads it.  imgio.h says what the calls
 * mean. */
#ifndef CAP_FILM_H
#define CAP_FILM_H
#include "capture/files/imgio.h"

#define CAP_FILMS_VERSION 1

struct film; /* opaque */
struct film_apng;

struct cap_films {
    int version; /* CAP_FILMS_VERSION */
    /* bytes: the size of the file, for the bound of picture.h */
    pvx_err (*open)(const char *path, uint64_t bytes, struct film **out,
                    struct cap_video_info *info, struct pvx_diag *d);
    pvx_err (*next)(struct film *f, struct cap_image *img, int64_t *t_ns, struct pvx_diag *d);
    pvx_err (*times)(const char *path, uint64_t bytes, int64_t **t_ns, size_t *n,
                     struct pvx_diag *d);
    void (*close)(struct film *f); /* NULL: nothing */
    /* `path` is for messages only, and borrowed until the end. */
    pvx_err (*apng_begin)(const char *path, int32_t w, int32_t h, int nch, int fps,
                          struct film_apng **out, struct pvx_diag *d);
    pvx_err (*apng_add)(struct film_apng *a, const uint8_t *samples, struct pvx_diag *d);
    /* The bytes of the file, from malloc.  It frees `a`, also on failure. */
    pvx_err (*apng_end)(struct film_apng *a, void **out, size_t *len, struct pvx_diag *d);
    void (*apng_drop)(struct film_apng *a); /* NULL: nothing */
};

const struct cap_films *cap_films_module(void);
#endif
