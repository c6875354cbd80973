/* board_picture.h - pictures of calibration boards with known truth.
 *
 * Shares nothing with recon's projection, print or detector: a pinhole with Brown's distortion, inverted
 * pixel by pixel by Newton's method; every pixel integrates its area over the board (supersampled), then
 * Gaussian blur, then noise.  Only the bits of the markers come from where all have them, OpenCV. */
#ifndef TESTS_BOARD_PICTURE_H
#define TESTS_BOARD_PICTURE_H
#include "recon/board/board.h"
#include "tests/lib/plugins.h"

struct board_shot {
    int32_t width, height;
    double f, cx, cy, k[5]; /* px; k1 k2 p1 p2 k3 */
    double R[9], t[3];      /* board to camera, m */
    double warp;            /* m, how far the board's middle bends out of its plane, towards -z */
    double blur, noise;     /* px; of full scale */
    double dark, light, ground; /* levels of ink, paper, and what is behind */
    double cover[4];            /* px: x0 y0 x1 y1 of something grey in front of it all */
    bool flipped;               /* the camera's driver mirrors the picture */
    int across;                 /* samples across a pixel; 0: 4 */
    uint64_t seed;
};

/* A shot of 640x480, f 600, levels 0.1, 0.8, 0.4: the board's middle straight ahead, `square` px wide
 * squares, tilted by `tilt` degrees about the direction `about` in the picture, then rolled. */
struct board_shot board_shot_of(const struct rec_board *b, enum rec_board_face face, double square,
                                double tilt, double about, double roll);

/* o = a b of 3x3 matrices, row major; o is neither. */
void board_matmul(const double a[9], const double b[9], double o[9]);

/* level [height][width]. */
void board_picture(const struct rec_board *b, const struct board_shot *s, float *level);

/* The face that is seen. */
enum rec_board_face board_face(const struct rec_board *b, const struct board_shot *s);

/* Where a corner of that face truly is; false outside the picture (3 px) or covered, with `near` squares
 * around the cover. */
bool board_truth(const struct rec_board *b, const struct board_shot *s, uint32_t id, double xy[2]);
#endif
