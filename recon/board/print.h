/* print.h - the print of a board: its markers, and where there is ink.
 *
 * Coordinates are those of board.h [m], on the front, as if the board were not inverted.  Square (0,0) of charuco and
 * chessboard is the black one at the top left (legacy: white, with marker 0); marker ids count along rows
 * (enum rec_grid_layout says which row is the first).  An aprilgrid has a black square of the gap's size at every crossing of gaps, the outer ones too, so that every corner
 * of a marker is a crossing of two edges.
 * Threads: a print is constant once made. */
#ifndef REC_BOARD_PRINT_H
#define REC_BOARD_PRINT_H
#include "base/err.h"
#include "recon/board/aruco_shim.h"
#include "recon/board/board.h"

struct rec_print {
    struct rec_board board;
    double x0, y0, x1, y1; /* the printed pattern, without paper around */
    double module;         /* m; side of a marker's bit, 0 without markers */
    double pitch, in; /* m; from square to square (gap to gap), and from its side to its marker's */
    double per_pitch, per_module; /* 1 over them */
    int32_t bits, border;         /* cells of a marker: across without its border; of the border */
    int32_t n_markers;
    uint8_t *bit;   /* [n_markers][bits][bits], 1 = white, as the marker stands on the board */
    int32_t *cell;  /* [n_markers] the marker's square, row * cols + column */
    int32_t *id_at; /* [cols * rows] its marker, -1 = none */
};

/* The module, loaded on first use.  PVX_EUNSUP: it cannot be loaded; d says what is missing. */
PVX_MUST_CHECK pvx_err rec_cv_load(const struct rec_cv **out, struct pvx_diag *d);

/* Owner: caller, rec_print_fini.  The module is needed where the board has markers. */
PVX_MUST_CHECK pvx_err rec_print_init(struct rec_print *p, const struct rec_board *b,
                                      struct pvx_diag *d);
void rec_print_fini(struct rec_print *p);

/* The marker's corners on the board, clockwise from the top left. */
void rec_print_marker(const struct rec_print *p, int32_t id, double xy[4][2]);

/* Share of ink, 0 to 1, in the rectangle of half sides hx, hy around (x, y); exact while the rectangle
 * meets no more than two bits, squares or gaps along each axis. */
double rec_print_ink(const struct rec_print *p, double x, double y, double hx, double hy);
#endif
