/* shaded.h - a volume to temperature and soot, with what its soot takes from its own light (recon/spectral/shade.h). */
#ifndef CLI_TEMPERATURE_SHADED_H
#define CLI_TEMPERATURE_SHADED_H
#include "daemon/cli/temperature/voxels.h"
#include "recon/spectral/shade.h"

struct temperature_shaded {
    struct rec_shade shade;
    float *f;   /* [n2][n1][n0] volume fraction */
    float *tau; /* [bricks][8^3][3] */
    uint32_t room;
};
/* kappa over f of the three channels as in shade.h.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err temperature_shaded_init(struct temperature_shaded *s,
                                               const struct rec_rig *rig, const struct pvp_grid *g,
                                               const double kappa[3]);
void temperature_shaded_fini(struct temperature_shaded *s);
/* As temperature_do, REC_SHADE_ROUNDS times more. */
PVX_MUST_CHECK pvx_err temperature_shaded(struct temperature_shaded *s,
                                          struct temperature_voxels *t, const struct vol_volume *v,
                                          struct pvx_diag *d);
#endif
