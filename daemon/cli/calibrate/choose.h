/* choose.h - which pictures a calibration uses, and which cameras of an older rig stay as they are. */
#ifndef DMN_CALIBRATE_CHOOSE_H
#define DMN_CALIBRATE_CHOOSE_H
#include "daemon/cli/calibrate/look.h"
#include "daemon/cli/calibrate/options.h"

/* Only pictures of numbers from..to.  PVX_EINVAL: a camera has none of them. */
PVX_MUST_CHECK pvx_err calibrate_only(struct calibrate_look *l, struct pvx_diag *d);

/* hold[] of all cameras: those of `add` are new, those of `recover` keep the lens of the old rig, the others keep
 * lens and pose.  PVX_EINVAL: names that do not go with the old rig or have no pictures. */
PVX_MUST_CHECK pvx_err calibrate_hold(struct calibrate_look *l, const struct rec_rig *old,
                                      const struct calibrate_names *add,
                                      const struct calibrate_names *recover, struct pvx_diag *d);

/* rig becomes the old rig with the cameras of `rig` that were not to stay in place of theirs or behind. */
PVX_MUST_CHECK pvx_err calibrate_merge(const struct calibrate_look *l, const struct rec_rig *old,
                                       struct rec_rig *rig, struct pvx_diag *d);
#endif
