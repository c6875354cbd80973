/* board.h - the calibration board that simulated cameras see with --board.
 *
 * In pose 0 it lies flat on the volume's floor, with its middle at x = y = 0 and its print up, as `calibrate` wants
 * the first picture.  The other poses are spread over the volume.  They face each camera in turn, and the direction
 * between it and the next one.  A pose has SIMCAMS_STILLS pictures that differ only by their noise, then
 * SIMCAMS_MOVES pictures of the way to the next pose.  Everything is a function of rig, board, poses and seed.
 *
 * Time: the board lies still until all cameras have sent a frame.  Then it stands still for `hold_s` at every pose
 * (0: until simcams_board_go), and moves to the next one during SIMCAMS_MOVE_TICKS pictures. */
#ifndef SIMCAMS_BOARD_H
#define SIMCAMS_BOARD_H
#include "base/err.h"
#include "recon/board/print.h"
#include "recon/geom/rig.h"

#define SIMCAMS_STILLS     2
#define SIMCAMS_MOVES      2
#define SIMCAMS_MOVE_TICKS 6
#define SIMCAMS_OF_POSE    (SIMCAMS_STILLS + SIMCAMS_MOVES)

struct simcams_board {
    struct rec_print print;
    size_t n;          /* poses */
    double (*pose)[6]; /* [n * SIMCAMS_OF_POSE] board -> world: rotation vector, m */
    double hold_s;
    /* where it is now */
    size_t at;  /* pose */
    int moving; /* pictures until it arrives there */
    bool begun; /* all cameras have sent */
    uint64_t tick;
    double since_s; /* time since which it stands still */
};

/* Owner: caller, simcams_board_fini, after an error too.  Errors: the board's; PVX_ENOMEM; PVX_EUNSUP. */
PVX_MUST_CHECK pvx_err simcams_board_init(const char *spec, const struct rec_rig *rig, size_t poses,
                                          double hold_s, uint32_t seed, struct simcams_board *b,
                                          struct pvx_diag *d);
/* How many cameras see the front of pose 0 by more than 20 degrees. */
size_t simcams_board_floor(const struct simcams_board *b, const struct rec_rig *rig);
/* Draw picture number `image` as this camera sees it, without noise, in all three channels of out [h][w][3]. */
PVX_MUST_CHECK pvx_err simcams_board_draw(const struct simcams_board *b, size_t image,
                                          const struct rec_camera *cam, float *out);
void simcams_board_fini(struct simcams_board *b);

/* Advance by one tick, the time of a picture.  Returns the picture to show.  all: every camera has sent a frame. */
size_t simcams_board_tick(struct simcams_board *b, double now_s, bool all);
/* Move on to that pose (modulo n). */
void simcams_board_go(struct simcams_board *b, size_t pose);

#endif
