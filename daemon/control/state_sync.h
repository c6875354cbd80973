/* state_sync.h - JSON of the cameras' health and of their synchronization: action commands, skews,
 * troubles (part of state.c). */
#ifndef DMN_STATE_SYNC_H
#define DMN_STATE_SYNC_H
#include "capture/rig/capture.h"
#include "daemon/control/json.h"

/* Members of a camera's object: rate and phase as measured, skew with its histogram, troubles. */
void dmn_state_sync_camera(struct dmn_json *j, const struct cap_camera_stats *k);
/* At the top: "skew" (edges of the histograms, and the histogram of the spread) and "host_clock". */
void dmn_state_sync(struct dmn_json *j, const struct cap_stats *s);
/* Inside a camera's object: "health" {serial, temperature_c, link_mbps, ptp, ptp_offset_ns, packets_resent,
 * packets_missing} and "action" {acknowledged, silent, refused, too_late, no_clock}. */
void dmn_state_health(struct dmn_json *j, const struct cap_camera_stats *k);
/* At the top: "action" {sent, late, failed}. */
void dmn_state_action(struct dmn_json *j, const struct cap_stats *s);
#endif
