/* aruco_shim.h - what the marker module (lib/pyrovox/pyrovox-aruco.so) offers, as plain C.
 *
 * OpenCV's contrib module aruco (Garrido-Jurado et al., Pattern Recognition 47(6), 2014) has the marker
 * dictionaries that everybody prints and a detector that is proven; it has no C interface.  The module is
 * loaded with dlopen by print.c on first use and exports one function, rec_cv_module.  Nothing throws
 * across this border: every entry returns a pvx_err value as int and puts a line into `err` when that is
 * not 0.  OpenCV is told to use no threads of its own: the caller has the threads.
 * Pictures: 8-bit grey, `stride` bytes from row to row; pixel (0,0) is the centre of the first pixel. */
#ifndef REC_ARUCO_SHIM_H
#define REC_ARUCO_SHIM_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define REC_CV_NOEXCEPT noexcept
#else
#define REC_CV_NOEXCEPT
#endif

#define REC_CV_VERSION 2

struct rec_cv_picture {
    const uint8_t *grey;
    int32_t width, height;
    ptrdiff_t stride;
};

struct rec_cv_marker {
    int32_t id;     /* -1: a quadrangle that is no marker of the dictionary */
    bool mirrored;  /* seen from behind */
    float xy[4][2]; /* px, from the marker's own first corner; clockwise unless it is mirrored */
};

struct rec_cv_search {
    int dictionary;
    double scale;      /* of the picture that is looked at; above 1 it is sharpened too */
    double min_side;   /* px, of a marker, in the picture as it is */
    double darker;     /* grey levels by which ink is darker than what is around it */
    bool mirrored_too; /* what could be both is taken for one that is not */
};

struct rec_cv {
    int version; /* REC_CV_VERSION */
    /* bits [n*n], 1 = white, row by row, without the border; n as the dictionary has it. */
    int (*bits)(int dictionary, int id, uint8_t *bits, char *err, size_t err_size) REC_CV_NOEXCEPT;
    /* At most `max` markers, those of the dictionary first. */
    int (*markers)(const struct rec_cv_picture *p, const struct rec_cv_search *s,
                   struct rec_cv_marker *out, size_t max, size_t *n) REC_CV_NOEXCEPT;
    /* All inner corners of a chessboard, along rows: xy [2*cols*rows].  *found: whether. */
    int (*chessboard)(const struct rec_cv_picture *p, int cols, int rows, float *xy,
                      int *found) REC_CV_NOEXCEPT;
};

const struct rec_cv *rec_cv_module(void) REC_CV_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
