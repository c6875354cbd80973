/* words.h - what a page says to the bridge: one JSON object per text message (PROTOCOL.md, Over a WebSocket).
 *
 * Unknown keys are ignored.  A known key with an invalid value makes the whole message invalid.
 * Threads: pure. */
#ifndef VIEW_WORDS_H
#define VIEW_WORDS_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "daemon/view/orders.h"

#define VIEW_WORDS_MAX    1024u /* bytes of a message */
#define VIEW_TOKEN_DIGITS 32    /* 128 bits */

enum view_said {
    VIEW_SAID_TOKEN = 1,
    VIEW_SAID_CREDITS = 2,
    VIEW_SAID_DRAWN = 4,
    VIEW_SAID_HIDDEN = 8,
    VIEW_SAID_PREVIEWS = 16,
    VIEW_SAID_PLAY = 32,
    VIEW_SAID_SEEK = 64,
    VIEW_SAID_SPEED = 128,
    VIEW_SAID_HELD = 256,
    VIEW_SAID_ORDER = 512,
    VIEW_SAID_BARS = 1024,
    VIEW_SAID_SOOT = 2048
};
struct view_words {
    unsigned said; /* VIEW_SAID_*: which of these are there */
    char token[VIEW_TOKEN_DIGITS + 1];
    uint64_t credits; /* volumes that the page can take beyond those granted before */
    uint64_t held;    /* set of the volume that is in the texture */
    uint64_t drawn;   /* set of the volume that is on the screen */
    bool hidden, previews, bars, play;
    bool soot;     /* of a recording of temperatures: show soot */
    uint64_t seek; /* volume of the recording */
    double speed;  /* 0.01 to 100 */
    enum view_order order;
};
/* false: not an object of JSON, or invalid. */
bool view_words_read(const char *text, size_t len, struct view_words *out);
#endif
