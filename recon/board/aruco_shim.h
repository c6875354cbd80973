/* aruco_shim.h - the functions of the marker module (lib/pyrovox/pyrovox-aruco.so) in plain C.
 *
 * OpenCV's contrib module aruco (Garrido-Jurado et al., Pattern Recognition 47(6), 2014) has the common marker
 * dictionaries and a proven detector, but no C interface.  print.c loads the module with dlopen on first use.  It
 * exports one function, rec_cv_module.  No exception crosses this border: every entry returns a pvx_err value as int
 * and puts a line into `err` when that is not 0.  OpenCV is told to start no threads; the caller has the threads.
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

#define REC_CV_VERSION 3

struct rec_cv_picture {
    const uint8_t *grey;
    int32_t width, height;
    ptrdiff_t stride;
};

struct rec_cv_marker {
    int32_t id;     /* -1: a quadrangle that is not a marker of the dictionary */
    bool mirrored;  /* seen from behind */
    float xy[4][2]; /* px, from the marker's own first corner; clockwise unless it is mirrored */
};

struct rec_cv_search {
    int dictionary;
    int border;        /* cells of a marker's border */
    double scale;      /* of the picture before the search; above 1 it is also sharpened */
    double min_side;   /* px, of a marker, in the picture as it is */
    double darker;     /* grey levels by which ink is darker than its surroundings */
    bool mirrored_too; /* find mirrored ones too; what fits both is not mirrored */
};

struct rec_cv {
    int version; /* REC_CV_VERSION */
    /* bits [n*n], 1 = white, row by row, without the border; n from the dictionary. */
    int (*bits)(int dictionary, int id, uint8_t *bits, char *err, size_t err_size) REC_CV_NOEXCEPT;
    /* At most `max` markers, those of the dictionary first. */
    int (*markers)(const struct rec_cv_picture *p, const struct rec_cv_search *s,
                   struct rec_cv_marker *out, size_t max, size_t *n) REC_CV_NOEXCEPT;
    /* All inner corners of a chessboard, along rows: xy [2*cols*rows].  *found: 1 if all were found. */
    int (*chessboard)(const struct rec_cv_picture *p, int cols, int rows, float *xy,
                      int *found) REC_CV_NOEXCEPT;
};

const struct rec_cv *rec_cv_module(void) REC_CV_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
