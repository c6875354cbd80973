/* refine.h - a rig corrected by a flame and written, for `calibrate refine` and
 * `calibrate solve --refine-with-flame`. */
#ifndef CALIBRATE_REFINE_H
#define CALIBRATE_REFINE_H
#include "daemon/cli/common/flame_sets.h"

/* Loads a->rig and a->frames, prints what every round made of it, and writes the rig to `out` where held-out frames
 * got better; *accepted: whether they did. */
PVX_MUST_CHECK pvx_err calibrate_refine_rig(const struct flame_sets_args *a, const char *out,
                                            bool *accepted, struct pvx_diag *d);
#endif
