/* modes.h - finds the mode of a libcamera camera that fits the configuration, and the camera that a name means
 * (private to libcamera.c; does not use libcamera itself).
 *
 * libcamera takes its formats' names from DRM, which counts from the least significant bit of a
 * little-endian word: its RGB888 is B, G, R in memory (CAP_BGR8), its BGR888 R, G, B (CAP_RGB8).
 * Formats of several planes (NV12) are not supported.
 * Source: drm_fourcc.h; libcamera, formats.h. */
#ifndef CAP_LIBCAMERA_MODES_H
#define CAP_LIBCAMERA_MODES_H
#include "capture/libcamera/shim.h"
#include "capture/source/source.h"

enum cap_pixfmt lc_pixfmt(struct cap_lc_format f); /* CAP_FMT_NONE: none of ours */
uint8_t lc_yuv(const struct cap_lc_layout *l);     /* enum cap_yuv */

/* Index of the mode for c, with the size in *w x *h; -1: none fits, and d lists the modes.  mode[0] is the one that
 * the camera would choose.  A size that its format does not list is tried anyway, because scalers support more sizes
 * than they list. */
int lc_choose(const struct cap_source_config *c, const struct cap_lc_mode *mode, size_t n,
              int32_t *w, int32_t *h, struct pvx_diag *d);

/* Index of the id that is `name`, or of the only id that contains it.
 * Errors: PVX_ENOENT, PVX_EINVAL (several); d lists the candidates. */
PVX_MUST_CHECK pvx_err lc_match(const char *name, const char *const *id, size_t n, size_t *out,
                                const struct cap_source_config *c, struct pvx_diag *d);
/* The name to write for an id: the part after its last backslash (which YAML would take as an escape), if this still
 * means only this camera. */
const char *lc_short_name(const char *const *id, size_t n, size_t i);
#endif
