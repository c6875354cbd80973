/* film_priv.h - inside the module of films: what its files give each other. */
#ifndef CAP_FILM_PRIV_H
#define CAP_FILM_PRIV_H
#include <libavutil/frame.h>
#include <libavutil/pixdesc.h>

#include "capture/files/film.h"

/* How the frames of one film become pictures. */
struct film_pixels {
    const AVPixFmtDescriptor *desc;
    enum cap_pixfmt fmt;
    int32_t width, height; /* of the picture, turned */
    uint8_t yuv;           /* enum cap_yuv */
    /* picture[first + x * right + y * down] = frame[y][x], in pixels */
    ptrdiff_t first, right, down;
    float luma_zero, luma_scale, chroma_scale; /* YUV: y = (Y - zero) scale */
    float of_chroma[3][2];                     /* R, G and B = y + of_chroma[][] . (cb, cr) */
    uint32_t *row;                             /* [3][width of a frame] */
    void *out;
    size_t size;
};

/* From the first frame.  `matrix` (NULL: none) is the display matrix.  Errors: PVX_EUNSUP, PVX_ENOMEM; `path` is for
 * messages.  The caller calls film_pixels_free, also on failure. */
PVX_MUST_CHECK pvx_err film_pixels_of(const char *path, const AVFrame *first, const int32_t *matrix,
                                      struct film_pixels *p, struct pvx_diag *d);
/* The picture is borrowed until the next call. */
void film_pixels_read(struct film_pixels *p, const AVFrame *frame, struct cap_image *img);
/* A palette of greys only makes a grey film, and stays so. */
bool film_pixels_same_palette(const struct film_pixels *p, const AVFrame *frame);
void film_pixels_free(struct film_pixels *p);
#endif
