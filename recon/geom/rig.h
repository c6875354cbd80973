/* rig.h - the calibrated rig: reconstruction volume and cameras, read from rig.yaml.
 *
 *   version: 1
 *   volume: { min: [..3], max: [..3], voxels: [..3] or auto (rec_rig_finest),
 *             basis: box|trilinear (optional: REC_BASIS_DEFAULT) }
 *   cameras: - { name, size: [w,h], K: [fx,fy,cx,cy], distortion: [0,4,5,8,12 or 14 numbers],
 *                model: pinhole (default), fisheye (distortion: [0 or 4 numbers]; camera.h (5)), scheimpflug
 *                (distortion: [14 numbers]; camera.h (6)) telecentric (K in pixels per metre; camera.h (7)) or
 *                rays (rays: FILE.npy, relative to this file, in place of K, R, t and windows, [h][w][6], or
 *                [h][w][k][6] for a bundle of k rays per pixel, without blur; ray_table.h),
 *                R: [9], t: [3],
 *                windows: [{ plane: [nx,ny,nz,d], thickness, n }] (optional: at most REC_WINDOWS flat plates of glass
 *                between the camera and all of the volume; n . x = d [m] on the face towards the camera; camera.h (8)),
 *                blur: { sigma } (px) or { aperture, focus } (m) (optional; bundle.h),
 *                gain: [1 or 3 numbers, optional],
 *                photometry: {...} (optional; photometry.h),
 *                uncertainty: { px, px_95, voxels, voxels_95 } (optional; struct rec_uncertainty) }
 *   bodies:  (optional: opaque bodies in the flame or in front of it; body.h; metres)
 *            - { name, box: { min: [3], max: [3] } }  or  { name, cylinder: { from: [3], to: [3], radius } }
 *            or { name, mesh: FILE.stl (relative to this file), scale: m per unit (1) }
 *   spectral: (optional: what the three channels see of the spectrum; spectral.h)
 * Distortion is in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty.  s (thin prism) must
 * be 0.  tx ty (tilted sensor) other than 0 make a pinhole without `model` a scheimpflug.  Four numbers with |p| > 0.02 need a `model`: they may be a fisheye's k1 k2 k3 k4.
 * Refused with "file:line: key: reason": unknown/duplicate keys, R not a rotation (|R R^T - I| and
 * |det - 1| > 1e-3; nearer ones are re-orthonormalised), empty or inverted volume, duplicate names,
 * names that are not [A-Za-z0-9._-]+, more than REC_MAX_CAMERAS, sizes outside 1..16384, a body around a
 * camera, a mesh that is not closed, has NaN, is a hundred times the volume or over 10^6 triangles.
 * Ownership: struct is the caller's memory; init by load/parse/ring, fini frees what it holds. */
#ifndef REC_RIG_H
#define REC_RIG_H
#include <stddef.h>
#include "base/err.h"
#include "recon/geom/body.h"
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"
#include "recon/geom/spectral.h"

#ifdef __cplusplus
extern "C" {
#endif

#define REC_MAX_CAMERAS 64

struct rec_rig {
    struct rec_grid grid;
    size_t n_cameras;
    struct rec_camera *cameras; /* [n_cameras] */
    struct rec_bodies bodies;
    struct rec_spectral *spectral; /* or NULL */
};

PVX_MUST_CHECK pvx_err rec_rig_load(const char *path, struct rec_rig *out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err rec_rig_parse(const char *text, size_t len, const char *name,
                                     struct rec_rig *out, struct pvx_diag *d);
/* YAML text that rec_rig_parse reads back to the same numbers (%.17g).  Owner: caller, free(). */
PVX_MUST_CHECK pvx_err rec_rig_format(const struct rec_rig *r, char **out, size_t *len);
void rec_rig_fini(struct rec_rig *r);
PVX_MUST_CHECK pvx_err rec_rig_copy(const struct rec_rig *r, struct rec_rig *out);

/* Whether `name` is allowed for a camera. */
bool rec_rig_name_ok(const char *name);
/* Index of the camera called `name`, or -1. */
int rec_rig_find(const struct rec_rig *r, const char *name);
/* Keep only the named cameras ("cam0,cam3"), in rig order.  PVX_ENOENT names the missing one. */
PVX_MUST_CHECK pvx_err rec_rig_select(struct rec_rig *r, const char *comma_list,
                                      struct pvx_diag *d);

/* The finest grid that the pictures can determine, over the box of r->grid, in near cubes of side
 *     h = max( 0.7 (C / D)^(1/2), (L / 30 D)^(1/3) ),   D = sum of (f / z)^2 / binning^2          (1)
 * D: bins per square metre at the middle of the box, over the C cameras that have it in front of them.
 * First limit: a voxel is not smaller than half a bin's diagonal.  Second limit: if a flame fills the box as
 * an ellipsoid (L: geometric mean of the sides), there are at most 20 unknowns for each measured value:
 * 3/2 D h^3 / L >= 1/20.  Both were chosen by measurement (NUMERICS.md, 1).  Sets n[3], at most
 * REC_GRID_FINEST along the longest side: a workstation can still hold the matrix of such a grid.  Each number
 * halves to 16..31 without remainder, so that no coarser level has a voxel that is half outside.
 * PVX_EINVAL: no camera has the middle of the box in front of it. */
#define REC_GRID_FINEST 256
PVX_MUST_CHECK pvx_err rec_rig_finest(const struct rec_rig *r, int32_t binning, int32_t n[3]);

/* The standard simulated rig: `n` cameras on a ring of radius `radius` m about the z axis, aimed at
 * (0,0,0.5) from heights that alternate slightly, 360 degrees, volume [-0.5,0.5]^2 x [0,1] in boxes, image
 * w x h, focal length so that the volume fills about 3/4 of the shorter image side, mild
 * distortion (k1 about -0.05) so that no code works only because distortion is absent. */
PVX_MUST_CHECK pvx_err rec_rig_ring(size_t n, double radius, int32_t w, int32_t h, int32_t voxels,
                                    struct rec_rig *out);

/* XXH3-64 over every number of the rig that geometry depends on (gain, photometry, spectral, names and uncertainty excluded). */
uint64_t rec_rig_hash(const struct rec_rig *r);

#ifdef __cplusplus
}
#endif
#endif
