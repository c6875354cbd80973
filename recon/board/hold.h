/* hold.h - the pose of a board that is held facing a direction. */
#ifndef REC_BOARD_HOLD_H
#define REC_BOARD_HOLD_H
#include "recon/board/board.h"

/* Board -> world.  The middle of the print at `at` [m], the front towards `face` (any length but 0), rows level,
 * then turned by `roll` [rad] clockwise as seen by a viewer in front of it.  If it faces straight up or down: rows
 * along x. */
void rec_board_hold(const struct rec_board *b, const double at[3], const double face[3],
                    double roll, double R[9], double t[3]);

#endif
