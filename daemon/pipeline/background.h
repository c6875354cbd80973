/* background.h - what the cameras see without a flame, taken while the daemon runs.
 *
 * After a request the carve stage adds up the sets that pass.  From the set after the last one on, their mean is
 * subtracted (photo.h).  The request fails and all stays as it was if something moves in the sets, if a camera is
 * missing from more than half of them, or if no set comes for 5 s.
 * The request's thread takes and frees all memory.  The carve stage only exchanges pointers with the carver.
 * Ownership: caller; rig borrowed.  Threads: begin and state from one at a time, look from the carve stage. */
#ifndef DMN_BACKGROUND_H
#define DMN_BACKGROUND_H
#include "daemon/pipeline/pipeline.h"

#define DMN_BACKGROUND_SETS_MAX 10000

typedef struct dmn_background dmn_background;
PVX_MUST_CHECK pvx_err dmn_background_new(const rec_sysmat *S, const struct rec_rig *rig, int nch,
                                          dmn_background **out, struct pvx_diag *d);
void dmn_background_free(dmn_background **b);
/* The mean of the next `sets` (2 or more) becomes the background.  0 removes the background and ends a request that
 * is under way.  Returns at once.  Errors: PVX_EINVAL, PVX_EBUSY (a request is under way), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_background_begin(dmn_background *b, uint32_t sets, struct pvx_diag *d);
/* State of the last request.  After a failure `why` says which camera and where. */
void dmn_background_state(dmn_background *b, struct dmn_background_state *out);
/* Call when a set's pixels are in its slot.  Cost without a request: one load. */
void dmn_background_look(dmn_background *b, const struct dmn_slot *s, dmn_pipeline *p);
#endif
