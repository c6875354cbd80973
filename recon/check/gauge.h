/* gauge.h - distance of two rigs, apart from what no picture can show.
 *
 * Pictures of a flame do not show where the world is, how it is turned and how large it is: a similarity T of the
 * world changes no projection when all cameras move with it.  So from a corrected rig the similarity
 *     T = argmin sum_c sum_k | pi_new,c(T X_k) - pi_old,c(X_k) |^2                                  (1)
 * over points X_k of the old rig's box (a lattice of REC_GAUGE_SIDE^3; those that both see) is removed.  What remains
 * of the sum is the distance.
 * Threads: pure. */
#ifndef REC_GAUGE_H
#define REC_GAUGE_H
#include "recon/geom/rig.h"

#define REC_GAUGE_SIDE 4

/* The world turned by w about X0, shifted by t (m) and scaled by 1 + s; the pictures stay the same. */
struct rec_similarity {
    double w[3], t[3], s;
};

/* Moves `rig`, which has the cameras of `old`, by (1).  Returns the distance, rms of pixels over cameras and
 * points; px [n_cameras]: that of each camera, or NULL. */
double rec_gauge_hold(const struct rec_rig *old, struct rec_rig *rig, double *px);
/* The same without (1), and without moving anything. */
double rec_gauge_distance(const struct rec_rig *a, const struct rec_rig *b, double *px);

/* Turns camera c about the point X0 of the world by w (rad, camera axes) and shifts it by t.  Points in camera
 * axes move by X_c -> Y0 + R(w) (X_c - Y0) + t, Y0 = R X0 + t_c. */
void rec_camera_nudge(struct rec_camera *c, const double X0[3], const double w[3],
                      const double t[3]);
/* J [2][7] = d pixel / d (w, t of rec_camera_nudge, ln f) of the world point X, at 0; uv may be NULL.
 * Behind windows it is that of a camera that takes its glass along, which differs by less than 1 %.
 * false: not in front of it. */
bool rec_camera_nudged(const struct rec_camera *c, const double X0[3], const double X[3],
                       double uv[2], double J[14]);

#endif
