/* state_sync.h - JSON of how well the cameras work together: skews, troubles (part of state.c). */
#ifndef DMN_STATE_SYNC_H
#define DMN_STATE_SYNC_H
#include "capture/rig/capture.h"
#include "daemon/control/json.h"

/* Members of a camera's object: rate and phase as measured, skew with its histogram, troubles. */
void dmn_state_sync_camera(struct dmn_json *j, const struct cap_camera_stats *k);
/* "skew" (edges of the histograms, and that of the spread) and "host_clock" of the whole. */
void dmn_state_sync(struct dmn_json *j, const struct cap_stats *s);

#endif
