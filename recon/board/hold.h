/* hold.h - where a board is when somebody holds it: its pose from what it faces. */
#ifndef REC_BOARD_HOLD_H
#define REC_BOARD_HOLD_H
#include "recon/board/board.h"

/* Board -> world.  The middle of the print at `at` [m], the front towards `face` (any length but 0), rows
 * level, then turned by `roll` [rad] clockwise as one sees it who stands there; flat (face straight up or down): rows
 * along x. */
void rec_board_hold(const struct rec_board *b, const double at[3], const double face[3],
                    double roll, double R[9], double t[3]);

#endif
