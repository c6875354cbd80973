/* watch.h - the rig looked at while it runs: a camera that was moved is named (recon/check/drift.h), and what else is
 * wrong with one, by the check that `pyrovox calibrate check` makes of a recording (recon/check/judge.h).
 *
 * A thread of the lowest priority (nice 19) takes carved frame sets when it is ready for them and rests four times as
 * long as they took, so it costs a fifth of a processor at most, and nothing where others need it.  Half of its time
 * it looks at single cameras of single sets, for the drift; the other half is a check, of DMN_WATCH_SETS sets in runs
 * that follow each other, with pauses for the first after each.  What it finds is a camera's state; what changes is a
 * line in the log.  The pictures of cameras that the vote left out are checked too: why, the check can say better.
 * Fewer than four cameras cannot contradict each other: nothing is looked at then.
 * Memory: that of unseen.h once, twenty pictures of 160 bins across or so for each camera; taken by the thread when
 * it starts.
 * Threads: new, free and offer's caller as said; state by any. */
#ifndef DMN_WATCH_H
#define DMN_WATCH_H
#include "daemon/control/state.h"
#include "daemon/pipeline/pipeline.h"

#define DMN_WATCH_RUN  4 /* sets that follow each other */
#define DMN_WATCH_SETS 8 /* of a check */

typedef struct dmn_watch dmn_watch;

/* rig and S are borrowed.  NULL in *out with fewer than four cameras.  Errors: PVX_ENOMEM, PVX_EIO (no thread to be had). */
PVX_MUST_CHECK pvx_err dmn_watch_new(const struct rec_rig *rig, const rec_sysmat *S,
                                     dmn_watch **out, struct pvx_diag *d);
void dmn_watch_free(dmn_watch **w);
/* After rec_frame_carve, by one thread: the set's pictures are copied when a set is wanted, else nothing is done.
 * NULL is fine. */
void dmn_watch_offer(dmn_watch *w, const struct dmn_slot *s);
/* out->rig of all cameras and out->checks; NULL: nothing is known. */
void dmn_watch_state(dmn_watch *w, struct dmn_state *out);
#endif
