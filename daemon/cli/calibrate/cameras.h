/* cameras.h - the cameras of a pyrovoxd.yaml before there is a rig.
 *
 * If `cameras` names each camera, these are used, sorted by name.  If a rig.yaml exists already, it gives the sizes
 * of the cameras that it has.  The other cameras are used as they are set.  If `cameras` is one pattern
 * for all cameras, it needs an existing rig. */
#ifndef CALIBRATE_CAMERAS_H
#define CALIBRATE_CAMERAS_H
#include "base/err.h"
#include "daemon/pipeline/sources.h"

struct calibrate_cameras {
    struct dmn_config *config; /* the sources borrow words of it */
    struct rec_rig rig; /* names and sizes only; its grid is the old rig's, n[0] 0: there is none */
    struct dmn_sources sources;
};

/* s must not be moved, because the sources borrow its names.  Owner: caller, until fini, after an error too.
 * Errors: the configuration's; PVX_EINVAL: no names; PVX_EUNSUP: cameras simulated in the program (sim:). */
PVX_MUST_CHECK pvx_err calibrate_cameras_init(struct calibrate_cameras *s, const char *config,
                                              struct pvx_diag *d);
void calibrate_cameras_fini(struct calibrate_cameras *s);

#endif
