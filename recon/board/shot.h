/* shot.h - a board as a camera of a rig sees it: pictures for simulations.
 *
 * Every pixel is the mean over its area.  `across` x `across` rays by rec_camera_ray meet the plane of the visible
 * face, and each takes the ink of the rectangle that it stands for (rec_print_ink).  Then follows a Gaussian blur.
 * The plate is flat and reaches half a square (a gap) beyond the print.  The bare back of a board that is not
 * two-sided is paper; the background is `ground`.
 * Tests of the detector have a renderer of their own, which shares nothing with this one. */
#ifndef REC_BOARD_SHOT_H
#define REC_BOARD_SHOT_H
#include "base/err.h"
#include "recon/board/print.h"
#include "recon/geom/camera.h"

struct rec_board_shot {
    const struct rec_print *print;
    const struct rec_camera *camera;
    double R[9], t[3];         /* board -> world, m; a thickness that is NAN counts as 0 */
    double ink, paper, ground; /* levels */
    double blur;               /* px */
    int across;                /* rays across a pixel, at least 1 */
};

/* level [height][width].  Errors: PVX_ENOMEM.  Threads: pure.  Cost: 1 us a pixel of the board at 4 rays
 * across. */
PVX_MUST_CHECK pvx_err rec_board_shoot(const struct rec_board_shot *s, float *level);

#endif
