/* scene.h - the analytic flame as pictures in a camera's pixel format: what sim: cameras see.
 *
 * Ownership: caller's; dmn_scene_cap borrows it.  Threads: different cameras at the same time, one
 * call per camera at a time.  Allocates nothing after dmn_scene_new. */
#ifndef DMN_SCENE_H
#define DMN_SCENE_H
#include "base/err.h"
#include "capture/source/source.h"
#include "recon/geom/rig.h"

typedef struct dmn_scene dmn_scene;
/* Standard flame in the rig's volume.  ignite_s > 0: it ignites once in each such period, at a random time, and burns
 * for a third of it.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_scene_new(const struct rec_rig *rig, uint32_t seed, double period_s,
                                     double ignite_s, dmn_scene **out);
void dmn_scene_free(dmn_scene **s);
/* The scene for capture, valid as long as s.  NULL if s is NULL. */
const struct cap_scene *dmn_scene_cap(const dmn_scene *s);

/* Linear image [h][w][3] float -> raw pixels of format `fmt`, tightly packed; values outside 0..1
 * are clipped, integers rounded. */
void dmn_scene_pack(const float *image, int32_t w, int32_t h, enum cap_pixfmt fmt, void *data);
#endif
