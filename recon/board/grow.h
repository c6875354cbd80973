/* grow.h - all corners of a board from a few of its points. */
#ifndef REC_BOARD_GROW_H
#define REC_BOARD_GROW_H
#include "recon/board/corner.h"
#include "recon/board/homography.h"
#include "recon/board/spec.h"

#define REC_BOARD_CORNERS (4 * REC_BOARD_MAX * REC_BOARD_MAX) /* of the largest board */

/* The result for one corner. */
struct rec_grown {
    bool found;
    struct rec_corner_fit fit;
};

/* seed [n_seed]: roughly known points of board and picture (markers' corners), weight 1 each.
 * corner [rec_board_corners]: out; pair: work area, [n_seed + corners].  Returns the number of corners found. */
size_t rec_grow(const struct rec_field *f, const struct rec_print *p, const struct rec_pair *seed,
                size_t n_seed, struct rec_pair *pair, struct rec_grown *corner);
#endif
