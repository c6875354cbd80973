/* trigger.h - action commands to all cameras, one per period and network (private to capture).
 *
 * At once (lead_ns = 0): sent at multiples of the period on the host's clock.  The cameras act when it arrives.
 * Scheduled (lead_ns > 0): for multiples of the period on the clock that the cameras share by PTP, each sent the lead
 * before.  The time of that clock comes from the cameras' readings (cap_health.clock); with shared_clock it is the
 * host's CLOCK_REALTIME.  When less than half of the lead is left, because the host was busy, nothing is sent: each
 * camera would execute a late command at its own moment or not at all.  Instants left out are counted and logged.
 * Answers are counted per camera: acknowledged, refused, and silent after 200 ms. */
#ifndef CAP_TRIGGER_H
#define CAP_TRIGGER_H
#include "capture/wire/action.h"
#include "capture/rig/capture_int.h"

void *cap_trigger_run(void *capture); /* thread, until stop */

/* Commands that were sent and wait for answers. */
#define CAP_TRIGGER_OPEN 32
struct cap_trigger_open {
    uint16_t number;             /* 0 = free */
    uint64_t expected, answered; /* bit = camera */
    int64_t until_mono_ns;
};
#endif
