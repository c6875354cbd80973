/* posefit.h - from displacements over a picture to the pose of its camera.
 *
 *     x = argmin sum_W (J_W x - d_W)' A_W (J_W x - d_W) + rho tr(A) m^2 sum_i (x_i / sigma_i)^2        (1)
 *
 * A_W, d_W = A_W^-1 v_W and the mean point X_W of window W: shift.h; J_W = d bin / d x at X_W, x: turn w [rad] and
 * shift t [m] about the middle X0 of the volume (rec_camera_nudge), and ln f if requested.  sigma_i, the prior
 * uncertainty of each: shifts, roll, distance m = REC_POSE_PX pixels at the flame; the direction from which the
 * camera looks and the focal length a tenth of that.  By this prior, numbers that the flame does not show stay 0.
 * The focal length is free only where the flame determines it better than the prior: (M^-1)_ff < sigma_f^2 / 2 in
 * the same units.
 * Threads: pure. */
#ifndef REC_POSEFIT_H
#define REC_POSEFIT_H
#include "recon/check/gauge.h"
#include "recon/check/shift.h"

#define REC_POSE_PX 3.0

enum {
    REC_POSE_FROM = 3,      /* bits of x that are held: the direction from which it looks */
    REC_POSE_DISTANCE = 32, /* how far away it is */
    REC_POSE_FOCAL = 64,
    REC_POSE_ALL = 127
};
struct rec_pose_fit {
    double x[7];   /* w, t, ln f */
    unsigned held; /* bit i: x[i] was held */
    double px[2];  /* displacement at X0, raw pixels */
    double roll;   /* rad, clockwise in the picture */
    double size;   /* size of the picture / expected size - 1 */
};
/* False: nothing is visible. */
bool rec_pose_fit(const struct rec_lattice *l, const struct rec_camera *c, const struct rec_grid *g,
                  int32_t binning, unsigned held, struct rec_pose_fit *out);
/* Applies the correction: the flame then projects to where the camera's picture shows it. */
void rec_pose_apply_fit(struct rec_camera *c, const struct rec_grid *g,
                        const struct rec_pose_fit *f);

#endif
