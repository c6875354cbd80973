/* events.h - events, each published to subscribers once (PROTOCOL.md, Event).
 *
 * They are found by comparing the daemon's state now with its state at the last look.  So no thread has to hand over
 * an event, and there is no queue that could overflow.  A camera that comes and goes a hundred times a second is one
 * event per look.  A look gives at most two events for each camera and six others.  Allocates nothing.
 * Threads: one caller per object. */
#ifndef DMN_EVENTS_H
#define DMN_EVENTS_H
#include "daemon/control/state.h"

#define DMN_EVENTS_DROPS 5 /* so many sets dropped within a second are a burst */

struct dmn_events {
    bool begun; /* the first look has been made */
    enum cap_state camera[CAP_MAX_CAMERAS];
    uint64_t out;
    struct dmn_events_recording {
        bool running;
        char path[512];
    } raw, volumes;
    int64_t t_second; /* monotonic time of the counts below */
    uint64_t dropped, refused;
};
struct dmn_events_listener {
    void (*say)(void *ctx, const char *json);
    void *ctx;
};
/* time_ns: UTC; mono_ns: clock for the events that come once a second at most.  The state at the first look is no
 * event, except a recording that runs. */
void dmn_events_look(struct dmn_events *e, const struct dmn_state *now, int64_t time_ns,
                     int64_t mono_ns, const struct dmn_events_listener *to);
#endif
