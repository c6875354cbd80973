#include "recon/calib/next.h"
pvx_err rec_calib_next(const struct rec_calib_input *in, const struct rec_rig *rig,
                       const struct rec_calib_report *r, struct rec_calib_next *out)
{
    (void)in, (void)rig, (void)r, (void)out;
    return PVX_ENOENT;
}
