/* opt_rig.h - the options that every command working on a rig shares, as an argp child.
 *
 *   --rig FILE --cameras A,B --grid N|NX,NY,NZ|auto --basis box|trilinear --binning N|auto --rays N|auto
 *   --threads N
 *
 * A command lists opt_rig_argp() among its children and hands over the struct in ARGP_KEY_INIT:
 *     case ARGP_KEY_INIT: state->child_inputs[0] = &my->rig; return 0;
 * and after argp_parse calls opt_rig_load.  Strings point into argv. */
#ifndef OPT_RIG_H
#define OPT_RIG_H
#include <argp.h>
#include "base/pool.h"
#include "recon/matrix/sysmat.h"

struct opt_rig {
    const char *path;                /* --rig; NULL when not given */
    const char *cameras;             /* NULL = all */
    int32_t grid[3];                 /* 0 = as the rig says */
    bool grid_one;                   /* one number was given for all three */
    bool grid_auto;                  /* the finest that the pictures hold; grid is 0 */
    int32_t basis;                   /* enum rec_basis, or -1 = as the rig says */
    struct rec_sysmat_params matrix; /* 0 = auto */
    unsigned threads;                /* 0 = one per CPU */
};
#define OPT_RIG_INIT \
    {                \
        .basis = -1  \
    }

const struct argp *opt_rig_argp(void);

/* "64" or "64,48,96", 1 to REC_GRID_MAX each. */
bool opt_rig_parse_grid(const char *s, int32_t n[3]);

/* Set rig->grid.n to the finest grid that the pictures support, over the box of rig->grid.  PVX_EINVAL. */
PVX_MUST_CHECK pvx_err opt_rig_finest(const struct opt_rig *o, struct rec_rig *rig,
                                      struct pvx_diag *d);

/* Read the rig and apply the options to it.  Errors are the rig's; PVX_EINVAL without --rig. */
PVX_MUST_CHECK pvx_err opt_rig_load(const struct opt_rig *o, struct rec_rig *out,
                                    struct pvx_diag *d);

/* Write `rig` to the file `to`.  Names of maps relative to rig.yaml `from` are changed so that they are found from
 * `to`.  from NULL: they stay as they are.  Meshes below the folder of `to` get names relative to it, other meshes
 * keep absolute names.  Errors: those of dmn_photometry_move and pvx_file_write. */
PVX_MUST_CHECK pvx_err opt_rig_save(const struct rec_rig *rig, const char *from, const char *to,
                                    struct pvx_diag *d);

#endif
