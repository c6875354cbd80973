/* screen.h - the live picture of a daemon, for `pyrovox top` and `pyrovox demo`.
 *
 * On a terminal it is redrawn in place on the terminal's second screen.  screen_close switches back to the first one.
 * Elsewhere it is a line after 1, 2, 4 s and so on, then each minute. */
#ifndef SCREEN_H
#define SCREEN_H
#include <stdbool.h>
#include "daemon/cli/common/follow.h"

struct screen {
    bool tty, open;
    long long next_ns, t0_ns;
};
void screen_open(struct screen *s);
/* Draw if it is time to.  `title` and `foot` are lines of text; either may be NULL. */
void screen_draw(struct screen *s, const struct follow *f, const char *title, const char *foot);
void screen_close(struct screen *s);
#endif
