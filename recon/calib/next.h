/* next.h - the pose of the board that would lower the volume error most, and its name in words. */
#ifndef REC_CALIB_NEXT_H
#define REC_CALIB_NEXT_H
#include "recon/calib/calib.h"

struct rec_calib_next {
    char text[120];   /* "face cam3, low, tilt left"; left and right as that camera sees them */
    uint32_t camera;  /* that it should face */
    double at[3];     /* m, world: middle of the print */
    double face[3];   /* unit vector, the way that the print looks */
    double now, then; /* voxels: volume error, rms over cameras, as it is and with that pose */
};

/* in, rig, r: a solve that went well.  PVX_ENOENT: no pose in the volume is seen by a camera; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_calib_next(const struct rec_calib_input *in, const struct rec_rig *rig,
                                      const struct rec_calib_report *r, struct rec_calib_next *out);

#endif
