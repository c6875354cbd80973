/* next.h - the pose of the board that would lower the volume error most, and its name in words.
 *
 * Information of all frames seen so far, with the board's own pose eliminated:
 *     L = sum_f ( U - W V^-1 W^T ),   U = A^T S A, W = A^T S B, V = B^T S B                     (1)
 * A, B: derivatives of the corners with respect to lenses and poses of the cameras, and to the pose of the board.
 * S: 1 / (variance of a corner of that camera times chi2).  The priors of lenses (adjust.c) are added.  The
 * volume error is tr(L^-1 H), with H from the derivatives of the error after the rigid motion of the world is removed
 * (expect.c).
 * A candidate adds its own term D of (1), in the block of the cameras that would see it:
 *     tr(L^-1 H) - tr((L + D)^-1 H) = tr( (I + D C)^-1 D C H C ),   C = L^-1                    (2)
 * Candidates: 27 places in the volume, facing each camera.  For each camera, three of the places are also tried with
 * a tilt of 40 degrees to the left, right, up and down; that is where two cameras can see the board.
 * To lower a trace of L^-1 most is A-optimal design: Pukelsheim, Optimal Design of Experiments, 1993.
 * The board counts as seen up to 65 degrees from its axis, if a square has at least 8 px, or as few as in some view
 * that was used.
 * Threads: pure.  Deterministic.  Cost: 8 cameras, 0.2 s. */
#ifndef REC_CALIB_NEXT_H
#define REC_CALIB_NEXT_H
#include "recon/calib/calib.h"

struct rec_calib_next {
    char text[160]; /* "face cam3, low, tilt left"; left and right as that camera sees them */
    uint32_t camera;
    double at[3];     /* m, world: the middle of the print */
    double face[3];   /* unit vector: direction that the print faces */
    double now, then; /* voxels: volume error, rms over cameras, now and with that pose */
};

/* in, rig, r: of a successful solve.  Errors: PVX_ENOENT: no camera would see any pose in the volume, or there is
 * too little information; PVX_EINVAL: rig or report of other cameras; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_calib_next(const struct rec_calib_input *in, const struct rec_rig *rig,
                                      const struct rec_calib_report *r, struct rec_calib_next *out);

#endif
