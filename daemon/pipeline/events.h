/* events.h - what has happened, said to subscribers once (PROTOCOL.md, Event): found by comparing what the daemon knows
 * about itself now with what it knew at the last look.
 *
 * So no thread has to hand anything over, nothing waits in a queue that could overflow, and who comes and goes a hundred
 * times a second is one event a look: a look gives at most two for each camera and six others.  Allocates nothing.
 * Threads: one caller per object. */
#ifndef DMN_EVENTS_H
#define DMN_EVENTS_H
#include "daemon/control/state.h"

#define DMN_EVENTS_DROPS 5 /* sets that were dropped within a second: a burst */

struct dmn_events {
    bool begun; /* there was a look */
    enum cap_state camera[CAP_MAX_CAMERAS];
    uint64_t out;
    struct dmn_events_recording {
        bool running;
        char path[512];
    } raw, volumes;
    int64_t t_second; /* mono, of the counts: */
    uint64_t dropped, refused;
};
struct dmn_events_listener {
    void (*say)(void *ctx, const char *json);
    void *ctx;
};
/* time_ns: UTC; mono_ns: for what is said once a second at most.  What is so at the first look has not happened, but a
 * recording that goes on. */
void dmn_events_look(struct dmn_events *e, const struct dmn_state *now, int64_t time_ns,
                     int64_t mono_ns, const struct dmn_events_listener *to);
#endif
