/* draws.h - live error bars: after a set was published, its solve is repeated at low priority.
 *
 * A thread of the lowest priority (nice 19) has a running estimate (recon/frame/running.h).  The solve stage offers it each
 * solved set.  It takes one if it has nothing to do and the live path has time to spare.  Then the slot keeps its systems
 * and the problem that was solved, and the solver gets another problem in exchange.  After the set was published the
 * thread repeats its solve, alone, without the pool of the stages, and the solve stage takes the slot back.  So no volume
 * waits for it: the pipeline has one slot and one system more, and the thread takes no lock of a stage.  A volume's bars
 * come from the sets before it.
 * A set that is not taken is counted by its cause.  The live path has no time to spare while a set waits for the solver,
 * when the set's solve ended at its deadline, for DMN_DRAWS_REST sets after one was dropped, and while the solver waits
 * for less than DMN_DRAWS_LEAST of the time.  And the thread takes at most DMN_DRAWS_SHARE times the processor time of
 * all else that the process does, in the mean over some DMN_DRAWS_MEAN sets.
 * Threads: as each function says; state from any.  Allocates nothing after start. */
#ifndef DMN_DRAWS_H
#define DMN_DRAWS_H
#include "daemon/control/state.h"
#include "daemon/pipeline/pipeline.h"

#define DMN_DRAWS_REST  16
#define DMN_DRAWS_LEAST 0.05
#define DMN_DRAWS_SHARE 0.8
#define DMN_DRAWS_MEAN  32

typedef struct dmn_draws dmn_draws;

/* give_back: called by the solve stage with a slot that the thread has done with.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_draws_new(const struct dmn_pipeline_params *p,
                                     void (*give_back)(void *ctx, struct dmn_slot *s), void *ctx,
                                     dmn_draws **out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err dmn_draws_start(dmn_draws *w); /* PVX_EIO: no thread could be started */
/* Call when the stages have ended; what the thread still has is given back. */
void dmn_draws_join(dmn_draws *w);
void dmn_draws_free(dmn_draws **w);

/* All below: w may be NULL, then nothing happens. */

/* The settings by which sets are solved have changed, or the cameras.  Any thread. */
void dmn_draws_outdate(dmn_draws *w);
/* A set is carved.  The carve stage. */
void dmn_draws_carved(dmn_draws *w, struct dmn_slot *s);
/* How the live path is, at the end of a solve. */
struct dmn_draws_load {
    bool waiting;      /* a set waits for the solver */
    uint64_t dropped;  /* sets so far, because of time */
    int64_t waited_ns; /* by the solver, so far */
    int64_t now_ns;
};
/* A set is solved.  true: its solve is repeated, s->again, so it keeps its systems.  The solve stage. */
bool dmn_draws_offer(dmn_draws *w, struct dmn_slot *s, const struct dmn_draws_load *load);
/* Fills s->bars, from the sets before it.  The sink's stage, before the set goes out. */
void dmn_draws_bars(dmn_draws *w, struct dmn_slot *s);
/* A set that is `again` was published: the thread has the slot from now on.  The sink's stage. */
void dmn_draws_take(dmn_draws *w, struct dmn_slot *s);
/* It will not be repeated: the slot has only its systems again.  The stage that has the slot. */
void dmn_draws_cancel(dmn_draws *w, struct dmn_slot *s);

void dmn_draws_state(dmn_draws *w, struct dmn_draws_state *out);
#endif
