/* match.h - finds which of the detected markers lie as on a board.
 *
 * Every pair of markers (their eight corners) gives a map board -> picture.  The map that most other markers agree
 * with is fitted anew to all those.  The order of the markers decides, without random numbers: the same markers
 * give the same bits.  A false or a moved marker is left out. */
#ifndef REC_BOARD_MATCH_H
#define REC_BOARD_MATCH_H
#include "recon/board/homography.h"
#include "recon/board/print.h"

struct rec_match {
    double h[9];     /* board to picture */
    size_t agreeing; /* markers that lie as on the board */
    double error;    /* px rms of their corners */
};

/* The marker's corners on the board and in the picture; returns 4. */
size_t rec_match_pairs(const struct rec_print *p, const struct rec_cv_marker *m,
                       struct rec_pair *pair);

/* px: side of a square of the same area. */
double rec_marker_side(const struct rec_cv_marker *m);

/* agrees [n]: which markers agree; may be NULL.  agreeing is 0 if there is no map. */
void rec_match(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
               struct rec_match *out, bool *agrees);

/* Markers' side / side in the print, median of the markers that agree; 1 where that ratio fits better; NAN for fewer than
 * 6. */
double rec_match_ratio(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                       const bool *agrees);

/* Finds a board of the same kind with another number of columns, with which clearly more markers agree; rows: the
 * least number it has.  False: there is none. */
bool rec_match_other(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                     size_t agreeing, int32_t *cols, int32_t *rows);
#endif
