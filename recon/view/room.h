/* room.h - a volume as a lamp in a virtual room that hides parts of it (paper 7, Figure 9).
 *
 * A pixel sees the flame in front of the first surface, and that surface in the flame's light:
 *     L = integral of e from the eye (or where the ray comes into the room) to the surface ds
 *         + albedo / pi x (E(p) + E_a)                                                          (1)
 * optically thin: flame behind the surface adds nothing.  E(p), irradiance: the emission of all voxels, each with its
 * own shadow (room_lamps.h (1)).  It is computed once for a volume, for all views, at points about 1/40 of the
 * flame's size apart, and is bilinear between them.  E_a, one number for the room: the light that the surfaces
 * reflect to each other, spread evenly,
 *     E_a = mean(albedo E) / (1 - mean(albedo)), by area                                         (2)
 * Source of (2): ambient term of M. Cohen, S. Chen, J. Wallace, D. Greenberg, A progressive refinement approach to
 * fast radiosity image generation, SIGGRAPH 1988, eq. (12).  Both bases: a voxel sends out 4 pi e dV in either.  L is
 * in the units of the volume's pictures, unclipped, and finite for any volume: negative, NaN or infinite values in it
 * are dark.
 *
 * The room fits a box (that of the flame rather than the grid's; all lengths scale with it): chequered floor under
 * it, four walls, ceiling, a pillar on the side of +x, a block.  Walls are visible from inside only, so a camera may
 * stand outside.  Parts of a volume outside the room or in a body are ignored.
 *
 *     rec_room *room;
 *     struct rec_camera c;
 *     e = rec_room_new(box.min, box.max, pool, &room);
 *     e = rec_room_light(room, &grid, dense, 3);            // per volume
 *     rec_room_camera(room, angle, elevation, 640, 480, &c);
 *     e = rec_room_render(room, &c, 2, image);              // per view
 *     rec_room_free(&room);
 *
 * Memory: 1.5 MB, and 150 bytes per voxel with light in it while it is being lit.
 * Threads: one call per rec_room at a time; parallel inside, same bits for any thread count. */
#ifndef REC_ROOM_H
#define REC_ROOM_H
#include "base/err.h"
#include "base/pool.h"
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct rec_room rec_room;

/* Room for a box [m], empty.  The pool is borrowed.  PVX_EINVAL: the box is not finite or has
 * no size; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_room_new(const double min[3], const double max[3], pvx_pool *pool,
                                    rec_room **out);
void rec_room_free(rec_room **r);

/* Put a volume into the room in place of the one before: dense [nz][ny][nx][nch], nch 1 or 3, on g.
 * It is borrowed until the next call or until the room is freed.  PVX_EINVAL, PVX_ENOMEM: the room is empty.
 * Cost: 10^5 points x some hundred balls of voxels, and at the edges of a body's shadow the voxels that the edge
 * crosses.  On two cores a second for 14 000 voxels with light, seven for 400 000. */
PVX_MUST_CHECK pvx_err rec_room_light(rec_room *r, const struct rec_grid *g, const float *dense,
                                      int nch);

/* Ideal camera on a circle in the room, `angle` rad from +x towards +y (0: behind the pillar, which hides
 * half of the flame), `elevation` rad above the horizon (to 1.5 either way). */
void rec_room_camera(const rec_room *r, double angle, double elevation, int32_t w, int32_t h,
                     struct rec_camera *out);

/* (1) as image [h][w][nch], mean over sub x sub rays per pixel (1..REC_RENDER_SUB_MAX); dark where a
 * ray misses the room.  PVX_EINVAL: sub, or the room is empty; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_room_render(const rec_room *r, const struct rec_camera *c, int sub,
                                       float *image);

#ifdef __cplusplus
}
#endif
#endif
