/* trigger.h - action commands to all cameras, one per period and network (private to capture).
 *
 * At once: sent at multiples of the period on the host's clock; the cameras act when it arrives.
 * Scheduled (lead_ns > 0): for multiples of the period on the clock that the cameras share by PTP,
 * each sent the lead before; what that clock shows comes from the cameras' readings
 * (cap_health.clock), with shared_clock it is the host's CLOCK_REALTIME.  When less than half of the
 * lead is left, because the host was busy, nothing is sent: a late command is executed at once or not
 * at all, each camera at its own moment.  Left out instants are counted and logged.
 * Answers are counted per camera: acknowledged, refused, and silent after 200 ms. */
#ifndef CAP_TRIGGER_H
#define CAP_TRIGGER_H
#include "capture/wire/action.h"
#include "capture/rig/capture_int.h"

void *cap_trigger_run(void *capture); /* thread, until stop */

/* Commands under way whose answers are waited for. */
#define CAP_TRIGGER_OPEN 32
struct cap_trigger_open {
    uint16_t number;             /* 0 = free */
    uint64_t expected, answered; /* bit = camera */
    int64_t until_mono_ns;
};
#endif
