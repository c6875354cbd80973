/* plan.h - `pyrovox reconstruct --plan`: time, memory and disk of a reconstruction, from a minute of it. */
#ifndef RECONSTRUCT_PLAN_H
#define RECONSTRUCT_PLAN_H
#include "daemon/cli/reconstruct/options.h"

/* Measures and prints on stdout; writes nothing but a volume into --out, which is taken away again.  o->plan_hours > 0: and
 * how many machines like this one would be done by then.  Errors: as the reconstruction's. */
PVX_MUST_CHECK pvx_err reconstruct_plan(const struct reconstruct_options *o, struct frames_in *in,
                                        const struct rec_frame_params *p, pvx_pool *pool,
                                        const struct rec_rig *rig, struct pvx_diag *d);

#endif
