/* background.h - what the cameras see without a flame, taken while the daemon runs.
 *
 * A request waits for the mean of some sets, which the carve stage adds up as they pass; from the next set on
 * it is subtracted (photo.h).  Refused, and all stays as it was: something moves in it, or a camera lacked
 * half of the sets.
 * Memory is taken by the request's thread, but the carver's own copy, which the carve stage takes the first time.
 * Ownership: caller; rig borrowed.  Threads: take from one at a time, look from the carve stage. */
#ifndef DMN_BACKGROUND_H
#define DMN_BACKGROUND_H
#include "daemon/pipeline/pipeline.h"

#define DMN_BACKGROUND_SETS_MAX 10000

typedef struct dmn_background dmn_background;
PVX_MUST_CHECK pvx_err dmn_background_new(const rec_sysmat *S, const struct rec_rig *rig, int nch,
                                          dmn_background **out, struct pvx_diag *d);
void dmn_background_free(dmn_background **b);
/* The mean of the next `sets` (2 or more) becomes the background; 0: there is none any more.  Returns when it
 * is done.  Errors: PVX_EINVAL (the sentence says which camera and where), PVX_ETIMEDOUT (no set came for 5 s),
 * PVX_EBUSY, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_background_take(dmn_background *b, uint32_t sets, struct pvx_diag *d);
/* A set's pixels have come into its slot.  Cost without a request: one load. */
void dmn_background_look(dmn_background *b, const struct dmn_slot *s, dmn_pipeline *p);
#endif
