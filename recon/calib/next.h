/* next.h - the pose of the board that would lower the volume error most, and its name in words.
 *
 * Information of what was seen: of every frame, with the board's own pose taken out,
 *     L = sum_f ( U - W V^-1 W^T ),   U = A^T S A, W = A^T S B, V = B^T S B                     (1)
 * A, B: derivatives of the corners by lenses and poses of the cameras, and by the pose of the board; S: one
 * over the variance of a corner of that camera times chi2; and the priors of lenses (calib.c).  The volume error
 * is tr(L^-1 H), H from the error's derivatives with the rigid motion of the world taken out (expect.c).
 * A candidate adds its own term D of (1), in the block of the cameras that would see it:
 *     tr(L^-1 H) - tr((L + D)^-1 H) = tr( (I + D C)^-1 D C H C ),   C = L^-1                    (2)
 * Candidates: 27 places in the volume x every camera faced; of each camera three places also tilted by 40
 * degrees, left, right, up and down, which is where two cameras see it.
 * Choosing what lowers a trace of L^-1 most is A-optimal design: Pukelsheim, Optimal Design of Experiments, 1993.
 * The board counts as seen down to 65 degrees from its axis and where a square has 8 px, or as few as in a view that
 * was used.
 * Threads: pure.  Deterministic.  Cost: 8 cameras, 0.2 s. */
#ifndef REC_CALIB_NEXT_H
#define REC_CALIB_NEXT_H
#include "recon/calib/calib.h"

struct rec_calib_next {
    char text[160]; /* "face cam3, low, tilt left"; left and right as that camera sees them */
    uint32_t camera;
    double at[3];     /* m, world: the middle of the print */
    double face[3];   /* unit vector: where the print looks to */
    double now, then; /* voxels: volume error, rms over cameras, as it is and with that pose */
};

/* in, rig, r: a solve that went well.  Errors: PVX_ENOENT: no pose in the volume that a camera would see, or the
 * information is not enough to tell; PVX_EINVAL: rig or report of other cameras; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_calib_next(const struct rec_calib_input *in, const struct rec_rig *rig,
                                      const struct rec_calib_report *r, struct rec_calib_next *out);

#endif
