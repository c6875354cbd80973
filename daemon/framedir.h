/* framedir.h - frames on disk: DIR/<camera name>/<frame number, 6 digits>.(npy|png|tif|tiff|jpg).
 * Threads: read only after scanning. */
#ifndef DMN_FRAMEDIR_H
#define DMN_FRAMEDIR_H
#include <stdbool.h>
#include "base/err.h"
#include "recon/geom/rig.h"

struct dmn_framedir {
    char dir[4096];
    size_t n_frames;
    uint32_t *number; /* [n_frames] ascending: union over the cameras */
    uint8_t *ext;     /* [n_frames][n_cameras] file type + 1, 0 = that camera has no such frame */
    size_t n_cameras;
};

/* Look what is there for the rig's cameras.  A camera without a folder or frames is allowed as long as one
 * has some; PVX_ENOENT (diag says what was looked for) when there are none at all. */
PVX_MUST_CHECK pvx_err dmn_framedir_scan(const char *dir, const struct rec_rig *rig,
                                         struct dmn_framedir *out, struct pvx_diag *d);
void dmn_framedir_fini(struct dmn_framedir *f);

/* Path of frame `i` of camera `c` into buf; false when there is none. */
bool dmn_framedir_path(const struct dmn_framedir *f, const struct rec_rig *rig, size_t i, size_t c,
                       char *buf, size_t size);
#endif
