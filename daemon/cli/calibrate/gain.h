/* gain.h - gains from a flame for `pyrovox calibrate gain --flame`: first from its integrated emission, then solved
 * alternately with the reconstruction (recon/check/gains.h). */
#ifndef CALIBRATE_GAIN_H
#define CALIBRATE_GAIN_H
#include "daemon/cli/calibrate/light.h"
#include "recon/check/gains.h"

struct calibrate_gain {
    int64_t sets; /* most sets, of all recordings together, for the alternation */
    bool quiet;
    const char *report; /* FILE.json or NULL */
    /* out: */
    double light[3][REC_MAX_CAMERAS];      /* integrated, by colour; 0: none */
    struct pvx_diag cut[REC_MAX_CAMERAS];  /* why a camera could not be integrated; "" */
    double integrated[3][REC_MAX_CAMERAS]; /* gains from it; 1 where there is none */
    double gain[3][REC_MAX_CAMERAS];
    int nch;                           /* colours that were solved: 1 (all alike) or 3 */
    struct rec_gains_report rounds[3]; /* [nch] */
    struct pvx_diag why[3];            /* [nch] why the integrated gains are kept; "" */
};
/* Write the gains into the rig of l, whose pictures are read already, and print what was found.  Errors: PVX_EINVAL
 * (nothing can be measured: names the camera and the reason), PVX_ECANCELED, those of flame_sets.h and rec_gains. */
PVX_MUST_CHECK pvx_err calibrate_gain_flame(struct calibrate_light *l, struct calibrate_gain *g,
                                            struct pvx_diag *d);
#endif
