/* state_health.h - how cameras are, and what became of action commands, as JSON for the status. */
#ifndef DMN_STATE_HEALTH_H
#define DMN_STATE_HEALTH_H
#include "capture/rig/capture.h"
#include "daemon/control/json.h"

/* Inside a camera's object: "health" {temperature_c, link_mbps, ptp, ptp_offset_ns, packets_resent,
 * packets_missing} and "action" {acknowledged, silent, refused, too_late, no_clock}. */
void dmn_state_health(struct dmn_json *j, const struct cap_camera_stats *k);
/* At the top: "action" {sent, late, failed}. */
void dmn_state_action(struct dmn_json *j, const struct cap_stats *s);
#endif
