/* screen.h - what `calibrate live` shows: a screen on a terminal, elsewhere a line whenever a
 * picture was taken or there is a new solution. */
#ifndef CALIBRATE_SCREEN_H
#define CALIBRATE_SCREEN_H
#include "daemon/cli/calibrate/watch.h"

struct live_screen {
    bool tty;
    int64_t next_ns;
    size_t said_taken, said_poses; /* in lines */
    enum live_now said_now;
};
void live_screen_open(struct live_screen *s);
/* Draw if it is time to. */
void live_screen_draw(struct live_screen *s, struct live *l);
void live_screen_close(struct live_screen *s);

#endif
