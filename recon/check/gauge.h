/* gauge.h - how far two rigs are from each other, once what no picture can tell is taken away.
 *
 * Pictures of a flame do not say where the world is, which way it is turned and how large it is: a similarity T
 * of the world changes no projection when all cameras go along.  So of a rig that is corrected,
 *     T = argmin sum_c sum_k | pi_new,c(T X_k) - pi_old,c(X_k) |^2                                  (1)
 * over points X_k of the old one's box (a lattice of REC_GAUGE_SIDE^3; those that both see) is taken out, and what
 * remains of the sum is the distance.
 * Threads: pure. */
#ifndef REC_GAUGE_H
#define REC_GAUGE_H
#include "recon/geom/rig.h"

#define REC_GAUGE_SIDE 4

/* c' of the same pictures in the world turned by w, shifted by t (m) about X0 and scaled by 1 + s. */
struct rec_similarity {
    double w[3], t[3], s;
};

/* Moves `rig`, which has the cameras of `old`, by (1).  Returns the distance, rms of pixels over cameras and
 * points; each camera's own into px [n_cameras], or NULL. */
double rec_gauge_hold(const struct rec_rig *old, struct rec_rig *rig, double *px);
/* The same without (1), and without moving anything. */
double rec_gauge_distance(const struct rec_rig *a, const struct rec_rig *b, double *px);

/* Turns camera c about the point X0 of the world by w (rad, camera axes) and shifts it: points in its axes go by
 * X_c -> Y0 + R(w) (X_c - Y0) + t, Y0 = R X0 + t_c. */
void rec_camera_nudge(struct rec_camera *c, const double X0[3], const double w[3],
                      const double t[3]);
/* J [2][7] = d pixel / d (w, t of rec_camera_nudge, ln f) of the world point X, at 0; uv may be NULL.
 * false: not in front of it. */
bool rec_camera_nudged(const struct rec_camera *c, const double X0[3], const double X[3],
                       double uv[2], double J[14]);

#endif
