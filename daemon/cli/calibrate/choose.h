/* choose.h - which pictures a calibration uses, and which cameras of an older rig stay as they are. */
#ifndef DMN_CALIBRATE_CHOOSE_H
#define DMN_CALIBRATE_CHOOSE_H
#include "daemon/cli/calibrate/look.h"
#include "daemon/cli/calibrate/options.h"

/* Keep only the pictures numbered l->from to l->to.  PVX_EINVAL: a camera has no such picture. */
PVX_MUST_CHECK pvx_err calibrate_only(struct calibrate_look *l, struct pvx_diag *d);

/* Set `hold` of all cameras.  Cameras of `add` are new, cameras of `recover` keep the lens of the old rig, and all
 * others keep lens and pose.  PVX_EINVAL: a name does not fit the old rig or has no pictures. */
PVX_MUST_CHECK pvx_err calibrate_hold(struct calibrate_look *l, const struct rec_rig *old,
                                      const struct calibrate_names *add,
                                      const struct calibrate_names *recover, struct pvx_diag *d);

/* Replace *rig by the old rig with the newly solved cameras in it.  A camera of *rig that did not keep lens and pose
 * replaces the old camera of its name, or is added at the end. */
PVX_MUST_CHECK pvx_err calibrate_merge(const struct calibrate_look *l, const struct rec_rig *old,
                                       struct rec_rig *rig, struct pvx_diag *d);
#endif
