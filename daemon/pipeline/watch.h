/* watch.h - watches the rig while it runs: it names a camera that was moved (recon/check/drift.h) and other faults of
 * a camera, by the check that `pyrovox calibrate check` makes of a recording (recon/check/judge.h).
 *
 * A thread of the lowest priority (nice 19) takes carved frame sets when it is ready and then rests four times as
 * long as it worked.  So it costs a fifth of a processor at most, and nothing if other threads need the processor.
 * Half of its time goes to the drift, with single cameras of single sets.  The other half goes to a check of
 * DMN_WATCH_SETS sets, in runs of consecutive sets, with a pause for the drift after each set.  A finding is a
 * camera's state; a change is a line in the log.  Cameras that the vote left out are checked too, as the check can
 * say better why.  Fewer than four cameras cannot contradict each other, so then nothing is watched.
 * It also asks whether pictures and rig belong together (recon/check/plausible.h).  Facts are judged with each check.
 * Hypotheses are tried with the first flame, while facts or cameras are wrong, and when dmn_watch_ask asks for it.
 * Then a check that is under way is given up.
 * Memory: that of unseen.h once, twenty pictures of 160 bins across or so for each camera; the thread takes it when
 * it starts.
 * Threads: new, free and offer as their comments say; state from any. */
#ifndef DMN_WATCH_H
#define DMN_WATCH_H
#include "daemon/control/state.h"
#include "daemon/pipeline/pipeline.h"

#define DMN_WATCH_RUN  4 /* sets that follow each other */
#define DMN_WATCH_SETS 8 /* of a check */

typedef struct dmn_watch dmn_watch;

/* rig and S are borrowed; rig_path: for the remedies; at_least: saturated pixels are lower bounds.  *out = NULL with
 * fewer than four cameras.  Errors: PVX_ENOMEM, PVX_EIO (no thread could be started). */
PVX_MUST_CHECK pvx_err dmn_watch_new(const struct rec_rig *rig, const char *rig_path, bool at_least,
                                     const rec_sysmat *S, dmn_watch **out, struct pvx_diag *d);
void dmn_watch_free(dmn_watch **w);
/* Call after rec_frame_carve, from one thread.  Copies the set's pictures if a set is wanted, else does nothing.
 * w may be NULL. */
void dmn_watch_offer(dmn_watch *w, const struct dmn_slot *s);
/* Fills out->rig of all cameras, out->checks and out->belong; w NULL: leaves them. */
void dmn_watch_state(dmn_watch *w, struct dmn_state *out);
/* Ask for a judgement of the next DMN_WATCH_SETS sets, and the state of that.  Errors: PVX_ENOENT: w is NULL;
 * PVX_ENOMEM: the thread could not begin. */
PVX_MUST_CHECK pvx_err dmn_watch_ask(dmn_watch *w, struct pvx_diag *d);
void dmn_watch_asked(dmn_watch *w, struct dmn_check_request *out);
#endif
