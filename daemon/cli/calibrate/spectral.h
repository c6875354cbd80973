/* spectral.h - shared by the files of `pyrovox calibrate spectral`: options, and light of known temperature. */
#ifndef CALIBRATE_SPECTRAL_H
#define CALIBRATE_SPECTRAL_H
#include "daemon/cli/calibrate/light.h"
#include "recon/spectral/curves.h"
#include "recon/spectral/known.h"

struct calibrate_spectral_args {
    struct calibrate_light_args light;
    const char *response, *filter, *emissivity, *volume;
    bool quantum;
    double kelvin[CALIBRATE_GROUPS]; /* of each --frames; NAN: not given */
    int32_t region[4];               /* x, y, width, height; width 0: the middle */
    double point[3], point_kelvin;   /* thermocouple; NAN: none */
    struct rec_known_doubt doubt;
    struct rec_soot_params soot;
};

/* One observation of each camera and group: pixel values, as the solver sees them, of the exposure *exposure [s] (that of the
 * first group; NAN: none is known).  All cameras have one response, so those that differ are named.  Errors: PVX_EINVAL: grey,
 * saturated or dark pictures, exposures of which some are known, a camera that sees other colours than the others. */
PVX_MUST_CHECK pvx_err calibrate_spectral_pictures(const struct calibrate_light *l,
                                                   const struct calibrate_spectral_args *a,
                                                   struct rec_known *out, size_t *n,
                                                   double *exposure, struct pvx_diag *d);
/* The emission of a recording of volumes at the thermocouple, mean over its sets with light there.  Errors: the reader's; PVX_EINVAL: one
 * channel, the point is outside or dark, its noise is not known. */
PVX_MUST_CHECK pvx_err calibrate_spectral_point(const struct calibrate_spectral_args *a,
                                                struct rec_known *out, struct pvx_diag *d);
#endif
