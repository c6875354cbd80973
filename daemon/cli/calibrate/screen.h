/* screen.h - the display of `calibrate live`.  On a terminal it is a screen.  Elsewhere it is a line for each picture
 * taken and each new solution. */
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
