/* match.h - which of the markers that were found lie as on a board.
 *
 * A map board -> picture from every pair of markers (their eight corners), the one that most others
 * agree with, then the best fit to those.  The order of the markers decides, no random numbers: the same
 * markers give the same bits.  A false or a moved marker is left out. */
#ifndef REC_BOARD_MATCH_H
#define REC_BOARD_MATCH_H
#include "recon/board/print.h"

struct rec_match {
    double h[9];     /* board to picture */
    size_t agreeing; /* markers that lie as on the board */
    double error;    /* px rms of their corners */
};

/* px: the side of a square of its area. */
double rec_marker_side(const struct rec_cv_marker *m);

/* agrees [n]: which ones; may be NULL.  agreeing is 0 where there is no map. */
void rec_match(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
               struct rec_match *out, bool *agrees);

/* Markers' side over what the print says, the median of those that agree; NAN of fewer than 4. */
double rec_match_ratio(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                       const bool *agrees);

/* A board of the same kind, of other columns, with which clearly more markers agree; rows: those it has
 * at least.  False: there is none. */
bool rec_match_other(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                     size_t agreeing, int32_t *cols, int32_t *rows);
#endif
