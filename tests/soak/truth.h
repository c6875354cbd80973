/* truth.h - which instant an image shows, by its pixels: the images that simulated cameras serve are all different,
 * and known beforehand (pyrovox simcams --write-frames). */
#ifndef SOAK_TRUTH_H
#define SOAK_TRUTH_H
#include "base/err.h"
#include "capture/sync/frameset.h"

struct truth {
    uint32_t n_cameras, n; /* images per camera */
    uint64_t hash[CAP_MAX_CAMERAS][64];
    int32_t width, height;
};

/* DIR/cam0/000000.png ...  Errors: PVX_ENOENT, PVX_ERANGE (over 64 images). */
PVX_MUST_CHECK pvx_err truth_load(struct truth *t, const char *dir, uint32_t n_cameras,
                                  struct pvx_diag *d);
/* Number of the image, -1 = none of this camera's. */
int truth_find(const struct truth *t, uint32_t camera, const struct cap_image *img);
#endif
