/* plan.h - `pyrovox reconstruct --plan`: predict time, memory and disk of a reconstruction from a minute of it. */
#ifndef RECONSTRUCT_PLAN_H
#define RECONSTRUCT_PLAN_H
#include "daemon/cli/reconstruct/options.h"

/* Measures and prints on stdout.  Writes only one volume into --out, and deletes it again.  o->plan_hours > 0: also
 * prints how many machines like this one finish in that time.  Errors: those of the reconstruction. */
PVX_MUST_CHECK pvx_err reconstruct_plan(const struct reconstruct_options *o, struct frames_in *in,
                                        const struct rec_frame_params *p, pvx_pool *pool,
                                        const struct rec_rig *rig, struct pvx_diag *d);

#endif
