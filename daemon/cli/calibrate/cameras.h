/* cameras.h - the cameras of a pyrovoxd.yaml before there is a rig.
 *
 * Where `cameras` names each, these are the cameras, in the order of their names; a rig.yaml that is there
 * already gives the sizes of those that it has, the others are taken as they are set.  A pattern for all
 * cameras needs the rig that it is for. */
#ifndef CALIBRATE_CAMERAS_H
#define CALIBRATE_CAMERAS_H
#include "base/err.h"
#include "daemon/pipeline/sources.h"

struct calibrate_cameras {
    struct dmn_config *config; /* the sources borrow words of it */
    struct rec_rig rig; /* names and sizes only; its grid is the old rig's, n[0] 0: there is none */
    struct dmn_sources sources;
};

/* s must not be moved; names are borrowed by the sources.  Owner: caller, fini, after an error too.
 * Errors: the configuration's; PVX_EINVAL: no names; PVX_EUNSUP: simulated in the program (sim:). */
PVX_MUST_CHECK pvx_err calibrate_cameras_init(struct calibrate_cameras *s, const char *config,
                                              struct pvx_diag *d);
void calibrate_cameras_fini(struct calibrate_cameras *s);

#endif
