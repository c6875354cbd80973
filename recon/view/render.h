/* render.h - a view of a volume by direct forward projection (paper 5): one traversal per ray. */
#ifndef REC_RENDER_H
#define REC_RENDER_H
#include "base/err.h"
#include "base/pool.h"
#include "recon/geom/body.h"
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"

#ifdef __cplusplus
extern "C" {
#endif

#define REC_RENDER_SUB_MAX 64

/* The viewpoint, and the bodies that may hide parts. */
struct rec_eye {
    const struct rec_camera *camera;
    const struct rec_bodies *bodies; /* rays end at them; NULL: none */
    int sub;                         /* sub x sub rays per pixel, 1..REC_RENDER_SUB_MAX */
};

/* dense [nz][ny][nx][nch] on g (basis as g says) -> image [h][w][nch] float, unclipped, mean over
 * the rays of a pixel; voxels behind the camera, or behind a body, are not seen.
 * Parallel over rows; same bits for any thread count.  PVX_EINVAL, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_render(const struct rec_grid *g, const float *dense, int nch,
                                  const struct rec_eye *eye, pvx_pool *pool, float *image);

/* Ideal camera on a circle about the volume's vertical axis, `angle` rad from +x towards +y,
 * `elevation` rad above the horizon (to 1.5 either way), looking at the centre, framing the volume
 * equally for every angle; for turntable pictures. */
void rec_orbit_camera(const struct rec_grid *g, double angle, double elevation, int32_t w,
                      int32_t h, struct rec_camera *out);

/* Ideal camera at `eye` m looking at `target`, `up` (any length) upwards in the image, `fov` rad from
 * the top of the image to its bottom, (0, pi).  PVX_EINVAL: eye is at target, or up lies along the
 * line of sight, or fov or size is out of range. */
PVX_MUST_CHECK pvx_err rec_look_at_camera(const double eye[3], const double target[3],
                                          const double up[3], double fov, int32_t w, int32_t h,
                                          struct rec_camera *out);

#ifdef __cplusplus
}
#endif
#endif
