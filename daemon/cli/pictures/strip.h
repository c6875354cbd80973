/* strip.h - several views of a volume side by side in one PNG, for people to look at. */
#ifndef DMN_STRIP_H
#define DMN_STRIP_H
#include <stdbool.h>
#include "base/err.h"
#include "base/pool.h"
#include "daemon/cli/pictures/look.h"
#include "recon/geom/body.h"
#include "recon/geom/grid.h"

enum { DMN_ELEVATION_DEG = 5 }; /* of the turntable's camera */

struct dmn_strip_params {
    double deg0, deg1;     /* first and last turntable angle */
    int views;             /* 1..64 */
    int32_t width, height; /* px of one view */
    int sub;               /* rays per pixel side */
    struct look look;      /* of a .png; automatic: the 99.8th percentile of the lit pixels is 1 */
    const struct rec_bodies *bodies; /* that hide parts of it; NULL: none */
};
extern const struct dmn_strip_params dmn_strip_defaults; /* 0..120 deg, 5 views of 240x320 */

/* dense [nz][ny][nx][nch] on g.  The camera frames the lit voxels (more than 2 % of the brightest), not the whole
 * box.  path: .png, or .npy for the linear values.  Errors: PVX_EINVAL, PVX_ENOMEM, the file's. */
PVX_MUST_CHECK pvx_err dmn_strip_save(const struct rec_grid *g, const float *dense, int nch,
                                      const struct dmn_strip_params *p, pvx_pool *pool,
                                      const char *path, struct pvx_diag *d);

/* Box around the voxels above 2 % of the brightest, and one more voxel all round.  The whole grid if all are dark. */
struct rec_grid dmn_lit_box(const struct rec_grid *g, const float *dense, int nch);

/* Factor that maps the 99.8th percentile of the values above 1 % of the brightest to 1.  0: all are dark.
 * PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_auto_exposure(const float *pix, size_t n, double *out);

/* The exposure of the lit box, seen from two sides of the turntable: the lesser of the two.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_flame_exposure(const struct rec_grid *g, const float *dense, int nch,
                                          pvx_pool *pool, double *out);

#endif
