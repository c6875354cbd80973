/* background.h - what the cameras see without a flame, taken while the daemon runs.
 *
 * After a request the carve stage adds up sets as they pass; from the one after the last on their mean is
 * subtracted (photo.h).  Failed, and all stays as it was: something moves in it, a camera lacked half of the
 * sets, or none came for 5 s.
 * All memory is taken and given back by the request's thread: with the carver the carve stage only exchanges.
 * Ownership: caller; rig borrowed.  Threads: begin and state from one at a time, look from the carve stage. */
#ifndef DMN_BACKGROUND_H
#define DMN_BACKGROUND_H
#include "daemon/pipeline/pipeline.h"

#define DMN_BACKGROUND_SETS_MAX 10000

typedef struct dmn_background dmn_background;
PVX_MUST_CHECK pvx_err dmn_background_new(const rec_sysmat *S, const struct rec_rig *rig, int nch,
                                          dmn_background **out, struct pvx_diag *d);
void dmn_background_free(dmn_background **b);
/* The mean of the next `sets` (2 or more) becomes the background; 0: there is none any more, and what is being
 * taken is not any more.  Returns at once.  Errors: PVX_EINVAL, PVX_EBUSY (one is being taken), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_background_begin(dmn_background *b, uint32_t sets, struct pvx_diag *d);
/* What became of the last request; `why` says which camera and where. */
void dmn_background_state(dmn_background *b, struct dmn_background_state *out);
/* A set's pixels have come into its slot.  Cost without a request: one load. */
void dmn_background_look(dmn_background *b, const struct dmn_slot *s, dmn_pipeline *p);
#endif
