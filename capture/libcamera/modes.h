/* modes.h - which of a libcamera camera's modes fits the configuration, and which camera a name
 * means (private to libcamera.c; knows no libcamera).
 *
 * libcamera takes its formats' names from DRM, which counts from the least significant bit of a
 * little-endian word: its RGB888 is B, G, R in memory (CAP_BGR8), its BGR888 R, G, B (CAP_RGB8).
 * Formats of several planes (NV12) are not taken.
 * Source: drm_fourcc.h; libcamera, formats.h. */
#ifndef CAP_LIBCAMERA_MODES_H
#define CAP_LIBCAMERA_MODES_H
#include "capture/libcamera/shim.h"
#include "capture/source/source.h"

enum cap_pixfmt lc_pixfmt(struct cap_lc_format f); /* CAP_FMT_NONE: none of ours */
uint8_t lc_yuv(const struct cap_lc_layout *l);     /* enum cap_yuv */

/* Index of the mode for c, size in *w x *h; -1: none fits, and d says what there is.  mode[0] is
 * what the camera would choose.  A size that is not among those of its format is tried anyway:
 * scalers have more than they list. */
int lc_choose(const struct cap_source_config *c, const struct cap_lc_mode *mode, size_t n,
              int32_t *w, int32_t *h, struct pvx_diag *d);

/* Index of the id that is `name`, or of the only one that contains it.
 * Errors: PVX_ENOENT, PVX_EINVAL (several); d lists those that it could be. */
PVX_MUST_CHECK pvx_err lc_match(const char *name, const char *const *id, size_t n, size_t *out,
                                const struct cap_source_config *c, struct pvx_diag *d);
/* What to write for id: without what is before its last backslash, which YAML would take as an escape, when that
 * still means it alone. */
const char *lc_short_name(const char *const *id, size_t n, size_t i);
#endif
