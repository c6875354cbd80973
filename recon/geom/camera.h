/* camera.h - one calibrated camera: pinhole with OpenCV's lens distortion, or OpenCV's fisheye.
 *
 *     X_cam = R X + t,   x = X_cam/Z_cam, y = Y_cam/Z_cam                               (1)
 *     r2 = x^2+y^2,  c = (1+k1 r2+k2 r2^2+k3 r2^3)/(1+k4 r2+k5 r2^2+k6 r2^3)            (2)
 *     x' = c x + 2 p1 x y + p2 (r2+2x^2),  y' = c y + p1 (r2+2y^2) + 2 p2 x y           (3)
 *     u = fx x' + cx,  v = fy y' + cy      pixel (0,0) is the CENTRE of the top-left pixel  (4)
 * A fisheye has, instead of (2) and (3), with k1 k2 k3 k4 of its own,
 *     r^2 = x^2+y^2,  T = atan r,  T_d = T (1+k1 T^2+k2 T^4+k3 T^6+k4 T^8),  (x',y') = T_d/r (x,y)     (5)
 * It is used in front of the camera only: T < 90 degrees.
 * Source: OpenCV calib3d's documented models, calib3d and fisheye; (5): Kannala and Brandt, IEEE TPAMI 28:1335, 2006.
 * Camera x right, y down, z forward.
 * Threads: all functions are pure. */
#ifndef REC_CAMERA_H
#define REC_CAMERA_H
#include <stdbool.h>
#include <stdint.h>
#include "recon/geom/photometry.h"

#ifdef __cplusplus
extern "C" {
#endif

#define REC_NAME_MAX 64

/* Expected volume error (recon/calib/calib.h) of this camera, and its limit at a probability of 95 %, in pixels and
 * in voxels of the rig's grid.  All 0: not known. */
struct rec_uncertainty {
    double px, px_95, voxels, voxels_95;
};

enum rec_camera_model { REC_PINHOLE, REC_FISHEYE };

struct rec_camera {
    char name[REC_NAME_MAX];
    int32_t width, height; /* px */
    double fx, fy, cx, cy; /* px */
    double dist[8]; /* k1 k2 p1 p2 k3 k4 k5 k6, or k1 k2 k3 k4 of a fisheye; unused ones are 0 */
    double R[9];    /* world -> camera, row major */
    double t[3];    /* m */
    float gain[3];  /* photometric scale per channel; 1 by default */
    enum rec_camera_model model;
    struct rec_uncertainty uncertainty;
    struct rec_photometry photometry;
};

/* World point [m] -> pixel by (1)-(5); false when it is not in front of the camera (Z <= 0) or so
 * far off axis that (2) or (5) is past its turning point (the lens model folds back there). */
bool rec_camera_project(const struct rec_camera *c, const double X[3], double uv[2]);

/* The same, but also false when the pixel is outside the picture. */
bool rec_camera_sees(const struct rec_camera *c, const double X[3], double uv[2]);

/* The same as rec_camera_project, with intermediate values: (x,y) of (1) and J = d(u,v)/d(x,y), row major, px. */
struct rec_projection {
    double x, y, u, v, J[4];
};
bool rec_camera_project_full(const struct rec_camera *c, const double X[3],
                             struct rec_projection *out);

/* Pixel (u,v), any real numbers -> ray: origin = camera centre [m], dir of unit length, both world.
 * Inverts (3) or (5) by Newton iteration to 1e-10 px; false where it has no inverse (far outside). */
bool rec_camera_ray(const struct rec_camera *c, double u, double v, double origin[3],
                    double dir[3]);

/* What a focal length is divided by for pixels per metre around X [m]: depth, or distance for a fisheye.  Not above 0:
 * X is not in front of the camera. */
double rec_camera_depth(const struct rec_camera *c, const double X[3]);

/* Camera centre -R^T t [m]. */
void rec_camera_centre(const struct rec_camera *c, double x[3]);

/* Pose of a camera at `at` [m] that looks at `to`.  World z is up in the image, or world y if it looks straight up or
 * down. */
void rec_camera_look(const double at[3], const double to[3], struct rec_camera *c);

#ifdef __cplusplus
}
#endif
#endif
