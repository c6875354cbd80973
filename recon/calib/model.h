/* model.h - equation (1) of calib.h for one corner, with its derivatives. */
#ifndef REC_CALIB_MODEL_H
#define REC_CALIB_MODEL_H
#include <stdbool.h>
#include "recon/geom/camera.h"

/* A lens, and the windows before it in camera axes (normals; their places are not looked at). */
struct rec_model {
    const double *lens; /* fx fy cx cy k1 k2 p1 p2 k3 */
    const struct rec_glass *window;
    int32_t windows;
};

/* A point in camera axes -> pixel.  Jl [2][9] and JX [2][3] may be
 * NULL.  False: the point is not in front of the camera, or there is
 * no way to it through the windows. */
bool rec_model_project(const struct rec_model *m, const double X[3], double uv[2], double *Jl,
                       double *JX);
/* Pixel without lens: (x/z, y/z), without windows.  By fixed-point iteration of the distortion; false where it diverges. */
bool rec_model_ideal(const double lens[9], const double uv[2], double xy[2]);

/* pose applied to X; J [3][6]: d out / d pose, R [9]: d out / d X; both or none may be NULL. */
void rec_model_move(const double pose[6], const double X[3], double out[3], double *J, double *R);

/* rec_model_move, then rec_model_project: X in the world -> Z in camera axes -> pixel.  A [2][15]: d pixel / d
 * (lens, pose); G [2][3]: d pixel / d X, may be NULL. */
bool rec_model_see(const struct rec_model *m, const double pose[6], const double X[3], double Z[3],
                   double uv[2], double *A, double *G);
/* d pixel / d (turn, shift) of a point that moves by turn x Y + shift, B [2][6], from G. */
void rec_model_turn(const double Y[3], const double G[6], double B[12]);

#endif
