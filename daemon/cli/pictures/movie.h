/* movie.h - many pictures, in a folder or a film: volumes from one place, or from a moving camera. */
#ifndef RENDER_MOVIE_H
#define RENDER_MOVIE_H
#include <stddef.h>
#include "base/pool.h"
#include "daemon/cli/pictures/render_options.h"
#include "recon/geom/rig.h"

/* vol [n]: paths of the volumes in order.  rig: its box is used for volumes without a .json.  camera: of
 * the rig, or NULL for other viewpoints.  Prints the time per picture at the end.
 * Errors name the file.  PVX_ECANCELED after Ctrl-C: the pictures and film written so far are complete. */
PVX_MUST_CHECK pvx_err render_movie(const struct render_options *o, const struct rec_rig *rig,
                                    const struct rec_camera *camera, char *const *vol, size_t n,
                                    pvx_pool *pool, struct pvx_diag *d);

/* The camera of --eye.  g: the volume, whose middle is the target if none is given. */
PVX_MUST_CHECK pvx_err render_eye(const struct render_options *o, const struct rec_grid *g,
                                  struct rec_camera *out, struct pvx_diag *d);

#endif
