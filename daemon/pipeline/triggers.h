/* triggers.h - what makes a take of the raw frames in memory (capture/take/ring.h): orders, times, a camera's line, and
 * conditions on the volumes.
 *
 * Each volume v (emission per metre in each voxel, mean of the channels) gives these values.  B: the voxels whose
 * centre is in the trigger's box, or all.  V: volume of a voxel.
 *     light     L = V sum over B of v                                    [m2]
 *     height    z below which 98 % of the light of B lies                [m]
 *     change    100 |L - L'| / L', L' of the set before                  [%]
 *     appears, vanishes: number of voxels of the hull in B
 * A condition holds above `above` (vanishes: at or below it).  When it holds in `agree` successive sets, the trigger
 * fires.  Its instant is the exposure of the first of these sets.  Then the value must have come to `release` before
 * it fires again, and hold_off must be over.  A condition that already holds in the first set fires only after it has
 * not held.
 * A line fires when it is high in a frame and was low in the frame before it that arrived.  Its instant is the exposure
 * of the frame in which it is high.  A line that is high in the first frame fires only after it was low.
 * Threads: look, tick and events from the publish stage; frame from one thread; order and state from any.  Allocates
 * nothing after new. */
#ifndef DMN_TRIGGERS_H
#define DMN_TRIGGERS_H
#include "capture/take/ring.h"
#include "daemon/config/config.h"
#include "daemon/pipeline/events.h"
#include "recon/frame/frame.h"

typedef struct dmn_triggers_run dmn_triggers_run;
/* c and ring are borrowed. */
PVX_MUST_CHECK pvx_err dmn_triggers_new(const struct dmn_config *c, cap_ring *ring,
                                        dmn_triggers_run **out);
void dmn_triggers_free(dmn_triggers_run **t);
/* Judges a volume.  t may be NULL. */
void dmn_triggers_look(dmn_triggers_run *t, const struct rec_sparse *v, uint64_t set,
                       int64_t t_exposure_ns);
/* Looks at the lines of a frame of the camera with this name; its frames come in order of exposure. */
void dmn_triggers_frame(dmn_triggers_run *t, const char *camera, const struct cap_frame *f);
/* Triggers whose time has come. */
void dmn_triggers_tick(dmn_triggers_run *t, int64_t now_ns);
/* Says what has fired since the last call (PROTOCOL.md, Event). */
void dmn_triggers_events(dmn_triggers_run *t, const struct dmn_events_listener *to);
/* Fires now.  name NULL: the order without a name.  *t_ns: its instant.  PVX_EUNSUP: there is no ring (t is NULL).
 * PVX_ENOENT: no trigger of this name. */
PVX_MUST_CHECK pvx_err dmn_triggers_order(dmn_triggers_run *t, const char *name, int64_t *t_ns,
                                          struct pvx_diag *d);
void dmn_triggers_state(dmn_triggers_run *t, struct dmn_triggers_state *out);

/* The value that a condition judges; *light: L of the set before, replaced by this set's. */
double dmn_trigger_value(const struct dmn_trigger *k, const struct rec_sparse *v, double *light);
#endif
