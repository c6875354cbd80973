/* poses.h - a rig's cameras as a page draws them, so that it need not read YAML. */
#ifndef VIEW_POSES_H
#define VIEW_POSES_H
#include <stddef.h>
#include "base/err.h"

/* {"rig":{"cameras":[{"name":..,"eye":[x,y,z],"corner":[[x,y,z],..4]}]}}: m, directions of unit length to the corners of
 * the picture from its top left on, as the lens has them.  Owner: caller, free(); zero-terminated.  Errors: those of
 * rec_rig_parse, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err view_poses(const char *yaml, size_t len, char **out, struct pvx_diag *d);
#endif
