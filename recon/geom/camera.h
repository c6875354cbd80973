/* camera.h - one calibrated camera: pinhole with OpenCV's lens distortion, Scheimpflug, OpenCV's fisheye or telecentric,
 * in air or behind flat glass.
 *
 *     X_cam = R X + t,   x = X_cam/Z_cam, y = Y_cam/Z_cam                               (1)
 *     r2 = x^2+y^2,  c = (1+k1 r2+k2 r2^2+k3 r2^3)/(1+k4 r2+k5 r2^2+k6 r2^3)            (2)
 *     x' = c x + 2 p1 x y + p2 (r2+2x^2),  y' = c y + p1 (r2+2y^2) + 2 p2 x y           (3)
 *     u = fx x' + cx,  v = fy y' + cy      pixel (0,0) is the CENTRE of the top-left pixel  (4)
 * A fisheye has, instead of (2) and (3), with k1 k2 k3 k4 of its own,
 *     r^2 = x^2+y^2,  T = atan r,  T_d = T (1+k1 T^2+k2 T^4+k3 T^6+k4 T^8),  (x',y') = T_d/r (x,y)     (5)
 * It is used in front of the camera only: T < 90 degrees.
 * Scheimpflug (OpenCV's tilted sensor, tilt = tau_x tau_y [rad]): between (3) and (4) the sensor is turned,
 *     M = R_y(tau_y) R_x(tau_x),  (a,b,c) = M (x',y',1),
 *     (x',y') <- (M33 a - M13 c, M33 b - M23 c) / c                                                 (6)
 * Telecentric: (x',y') = (X_cam, Y_cam) in metres, so fx and fy are pixels per metre; it has no distortion.    (7)
 * Rays: a ray per pixel from a file, or the mean ray of its bundle, interpolated between pixels (ray_table.h);
 * (x',y') is the pixel in the file.
 * R and t are axes along their mean.  Points are projected by Newton's method.                                  (9)
 * Windows: flat plates of glass with air on both sides.  A plate (unit normal N, thickness T, index n) leaves the
 * direction d of a ray as it is and moves the ray, by Snell's law at both faces, by
 *     S(d) = T (1 - g / sqrt(n^2 - 1 + g^2)) N,   g = N.d                                            (8)
 * wherever it stands.  Several plates add up.  So a point X behind the glass is seen as (1)-(7) see X - S(d), where d is
 * the direction of its own ray: solved by Newton's method.  A point in the glass or before it is not seen.
 * Source: OpenCV calib3d's documented models, calib3d and fisheye; (5): Kannala and Brandt, IEEE TPAMI 28:1335, 2006.
 * (6): calib3d's model of 14 coefficients, written out.  (8): own derivation from Snell's law.
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

#define REC_WINDOWS 4 /* of a camera, at most */

enum rec_camera_model { REC_PINHOLE, REC_FISHEYE, REC_SCHEIMPFLUG, REC_TELECENTRIC, REC_RAYS };
struct rec_ray_table;

/* A flat plate of glass in air, between the camera and the volume. */
struct rec_glass {
    double normal[3];        /* unit, from the camera to the flame */
    double at;               /* m: normal . x = at on the face towards the camera */
    double thickness, index; /* m; against air, >= 1 */
};

/* What blurs its pictures, all 0: nothing.  A Gaussian of sigma px, or the defocus of a thin lens: its aperture's
 * diameter [m], and the distance [m] along its axis at which it is sharp.  Or the bundle of `rays` rays that each pixel has
 * in the table. */
struct rec_blur {
    double sigma, aperture, focus;
    int32_t rays; /* 0: not a bundle */
};

struct rec_camera {
    char name[REC_NAME_MAX];
    int32_t width, height; /* px */
    double fx, fy, cx, cy; /* px */
    double dist[8]; /* k1 k2 p1 p2 k3 k4 k5 k6, or k1 k2 k3 k4 of a fisheye; unused ones are 0 */
    double R[9];    /* world -> camera, row major */
    double t[3];    /* m */
    float gain[3];  /* photometric scale per channel; 1 by default */
    enum rec_camera_model model;
    double tilt[2];    /* rad, of a Scheimpflug's sensor; else 0 */
    int32_t n_windows; /* 0: in air */
    struct rec_glass window[REC_WINDOWS];
    const struct rec_ray_table *table; /* of REC_RAYS, else NULL; the process owns it */
    struct rec_blur
        blur; /* bundle.h; a pixel's middle ray and the projection of a point do not depend on it */
    struct rec_uncertainty uncertainty;
    struct rec_photometry photometry;
};

/* The model's name in rig.yaml. */
const char *rec_camera_model_name(enum rec_camera_model m);

/* World point [m] -> pixel by (1)-(8); false when it is not in front of the camera (Z <= 0) or behind its windows, or
 * so far off axis that (2) or (5) is past its turning point (the lens model folds back there). */
bool rec_camera_project(const struct rec_camera *c, const double X[3], double uv[2]);

/* The same, but also false when the pixel is outside the picture. */
bool rec_camera_sees(const struct rec_camera *c, const double X[3], double uv[2]);

/* The same as rec_camera_project, with intermediate values: (x,y) of (1), or (X_cam,Y_cam) of (7), or (x',y') of (9), and
 * J = d(u,v)/d(x,y), row major, px.  Behind windows they are those of X - S. */
struct rec_projection {
    double x, y, u, v, J[4];
};
bool rec_camera_project_full(const struct rec_camera *c, const double X[3],
                             struct rec_projection *out);

/* The same, and D [2][3] = d(u,v)/dX_cam [px/m], row major. */
bool rec_camera_slopes(const struct rec_camera *c, const double X[3], struct rec_projection *out,
                       double D[6]);

/* Pixel (u,v), any real numbers -> ray: origin [m], dir of unit length, both world.  The origin is the camera's centre,
 * for a telecentric the point of its ray beside the centre, and behind windows the place where the ray leaves the last
 * one.  False also where the ray does not pass a window.
 * Inverts (3) or (5) by Newton iteration to 1e-10 px; false where it has no inverse (far outside). */
bool rec_camera_ray(const struct rec_camera *c, double u, double v, double origin[3],
                    double dir[3]);

/* The same for the ray that enters the lens at (from[0], from[1]) m beside its middle, along the camera's x and y, and
 * crosses the middle ray at Z_cam = blur.focus, if there were no windows.  For pinhole and Scheimpflug. */
bool rec_camera_ray_from(const struct rec_camera *c, double u, double v, const double from[2],
                         double origin[3], double dir[3]);

/* The same for ray i of the bundle in the table; blur.rays > 0. */
bool rec_camera_ray_of(const struct rec_camera *c, double u, double v, int32_t i, double origin[3],
                       double dir[3]);

/* What a focal length is divided by for pixels per metre around X [m]: depth, distance for a fisheye, 1 for a
 * telecentric (windows are left out of account, which is right to some 1 %).  Not above 0:
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
