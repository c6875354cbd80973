/* watch.h - the rig looked at while it runs: a camera that was moved is named (recon/check/drift.h).
 *
 * A thread of the lowest priority (nice 19) takes a carved frame set when it is ready for one and looks at
 * some cameras; it rests four times as long as that took, so it costs a fifth of a processor at most, and
 * nothing where others need it.  What it knows is a camera's state; what changes is a line in the log.
 * Fewer than four cameras cannot contradict each other: nothing is looked at then.
 * Memory: drift.h's, taken by the thread when it starts.
 * Threads: new, free and offer's caller as said; state by any. */
#ifndef DMN_WATCH_H
#define DMN_WATCH_H
#include "daemon/control/state.h"

typedef struct dmn_watch dmn_watch;

/* rig and S are borrowed.  NULL in *out with fewer than four cameras.  Errors: PVX_ENOMEM, PVX_EIO (no thread to be had). */
PVX_MUST_CHECK pvx_err dmn_watch_new(const struct rec_rig *rig, const rec_sysmat *S,
                                     dmn_watch **out, struct pvx_diag *d);
void dmn_watch_free(dmn_watch **w);
/* After rec_frame_carve, by one thread: the pictures of the cameras in mask are copied when a set is wanted, else
 * nothing is done.  NULL is fine. */
void dmn_watch_offer(dmn_watch *w, const rec_frame *f, uint64_t mask);
/* out->rig of all cameras; NULL: nothing is known. */
void dmn_watch_state(dmn_watch *w, struct dmn_state *out);
#endif
