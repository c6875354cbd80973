/* shelf.h - the newest message of each kind, for every page that comes or falls behind.
 *
 * It holds one message of each kind, and the last VIEW_EVENTS events.  A slot's number counts all messages that were
 * put there.  So a page compares two numbers to know whether there is a new one and how many it was not given.  A
 * message is copied once, when it comes; pages borrow it.  A new session empties all slots but keeps their numbers.
 * Threads: one. */
#ifndef VIEW_SHELF_H
#define VIEW_SHELF_H
#include "proto/relay.h"

#define VIEW_EVENTS 16

enum view_slot {
    VIEW_START,
    VIEW_RIG,
    VIEW_POSES, /* a text that the bridge made of the rig (poses.h) */
    VIEW_STATUS,
    VIEW_BARS, /* of the volume; empty if it has none */
    VIEW_VOLUME,
    VIEW_PREVIEW,
    VIEW_END,
    VIEW_SLOTS
};
struct view_msg {
    uint64_t number; /* of its slot, from 1; 0: the slot is empty */
    size_t len;
    const void *data;
    int64_t came_ns; /* mono clock */
    /* volumes */
    uint64_t set;
    int64_t published_ns; /* real clock of the daemon's host */
};
typedef struct view_shelf view_shelf;
PVX_MUST_CHECK pvx_err view_shelf_new(view_shelf **out);
void view_shelf_free(view_shelf **s);
/* A message as it came, well-formed by pvp_sub_next.  Repetitions of start and rig are left out. */
PVX_MUST_CHECK pvx_err view_shelf_put(view_shelf *s, const struct pvp_header *h, const void *msg,
                                      size_t len, struct pvx_diag *d);
/* The error bars of the volume that is put next; NULL: it has none. */
PVX_MUST_CHECK pvx_err view_shelf_put_bars(view_shelf *s, const void *msg, size_t len,
                                           struct pvx_diag *d);
/* A text of the bridge's own. */
PVX_MUST_CHECK pvx_err view_shelf_put_text(view_shelf *s, enum view_slot slot, const char *text,
                                           struct pvx_diag *d);
/* Number of the slot's newest message; 0: the slot is empty. */
uint64_t view_shelf_number(const view_shelf *s, enum view_slot slot);
/* The newest; borrowed until the next put.  small: a volume is packed, whatever it costs. */
PVX_MUST_CHECK pvx_err view_shelf_get(view_shelf *s, enum view_slot slot, bool small,
                                      struct view_msg *out, struct pvx_diag *d);
/* The first event after number `after`; false: none. */
bool view_shelf_event(const view_shelf *s, uint64_t after, struct view_msg *out);
#endif
