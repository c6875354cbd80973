/* board.h - a calibration board, and a camera's view of it.
 *
 * Board coordinates [m]: the front's first inner corner (aprilgrid: the first marker's first corner) is the
 * origin, x along a row of the print, y down the print, z into the board, so that a camera that sees the front has
 * the board's z axis pointing away from it.  A two-sided board has a mirrored back: the print on the back is such
 * that the corner `id` of the back lies exactly behind the corner `id` of the front, at z = thickness.  Corner ids
 * count along rows, row by row, the same on both faces. */
#ifndef REC_BOARD_H
#define REC_BOARD_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum rec_board_kind { REC_CHARUCO, REC_CHESSBOARD, REC_APRILGRID };
/* How an aprilgrid was drawn, bits.  0: as sheet.h draws it, marker 0 at the top left, as OpenCV draws markers. */
enum rec_grid_layout {
    REC_GRID_UP = 1,     /* marker 0 at the bottom left, rows count upwards */
    REC_GRID_TURNED = 2, /* markers stand as AprilTag draws them: half a turn against OpenCV */
    REC_GRID_WIDE = 4,   /* a marker's border is two cells wide */
    REC_GRID_KALIBR = 7
};
enum rec_board_face { REC_FRONT, REC_BACK };

struct rec_board {
    enum rec_board_kind kind;
    int32_t cols, rows;  /* charuco: squares; chessboard: inner corners; aprilgrid: markers */
    double square;       /* m; aprilgrid: side of a marker */
    double marker;       /* m; aprilgrid: gap between markers */
    char dictionary[32]; /* "5X5_100"; "" for a chessboard */
    bool legacy;         /* charuco of even rows as OpenCV before 4.6 drew them */
    uint8_t grid;        /* aprilgrid: bits of enum rec_grid_layout */
    bool inverted;       /* white and black change places */
    bool two_sided;
    double thickness; /* m; NAN: to be estimated */
};

/* Number of corners of a face, and the place of one [m] (see above; thickness NAN counts as 0). */
uint32_t rec_board_corners(const struct rec_board *b);
void rec_board_point(const struct rec_board *b, enum rec_board_face face, uint32_t id,
                     double xyz[3]);

/* A corner in a picture; pixel (0,0) is the CENTRE of the top-left pixel. */
struct rec_board_corner {
    uint32_t id;
    double x, y;   /* px */
    double cov[3]; /* xx, xy, yy, px^2 */
};

/* One face of the board in one picture.  Owner of corner[]: the code that made the view. */
struct rec_board_view {
    uint32_t camera; /* index */
    uint32_t frame;  /* pictures of one instant have one number */
    enum rec_board_face face;
    size_t n;
    struct rec_board_corner *corner; /* [n], ids ascending, each once */
};

#endif
