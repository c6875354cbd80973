/* page.h - one page, or another program, at the other end of a WebSocket.
 *
 * A browser cannot push back on a WebSocket, so the page grants credits.  For each credit one volume is sent, the
 * newest at that instant.  At most one message waits to be sent, and TCP_NOTSENT_LOWAT keeps the kernel from taking
 * more than it can send.  So a slow page gets fewer volumes and never older ones.  A hidden page gets no volumes and
 * no previews, but all else.
 * Threads: one. */
#ifndef VIEW_PAGE_H
#define VIEW_PAGE_H
#include <poll.h>
#include "base/hist.h"
#include "daemon/view/gate.h"
#include "daemon/view/shelf.h"

#define VIEW_CREDITS_MAX  8
#define VIEW_HELLO_NS     5000000000LL  /* a page that has not shown its token by then is closed */
#define VIEW_CLOSE_TOKEN  4401          /* close codes: the token is not this bridge's */
#define VIEW_CLOSE_WORDS  4400          /* a message that is not understood */
#define VIEW_CLOSE_SILENT 4408          /* no token in time */
#define VIEW_CLOSE_FULL   4503          /* as many pages as there is room for */
#define VIEW_RECENT_NS    10000000000LL /* what `recent` looks back at, and as much again at most */

struct view_page_stats {
    uint64_t sent, drawn; /* volumes */
    uint64_t superseded;  /* not sent, as a newer one came first */
    uint64_t hidden;      /* not sent, as the page was hidden */
};
enum view_way {
    VIEW_DRAWN, /* handed to the socket -> reported as drawn */
    VIEW_HELD,  /* published by a daemon on this host -> reported as in the texture */
    VIEW_WHOLE, /* published by a daemon on this host -> reported as drawn */
    VIEW_WAYS
};
typedef struct view_page view_page;
/* fd stays the caller's, non-blocking.  early: bytes that came after the request. */
PVX_MUST_CHECK pvx_err view_page_new(int fd, const struct view_gate *gate, const void *early,
                                     size_t n_early, view_page **out);
void view_page_free(view_page **p);
short view_page_wants(const view_page *p); /* events to poll for */
/* Reads what the page has sent.  true: out has what it said since the last call for the source (play, seek, speed),
 * and orders.  Nothing counts before the right token. */
bool view_page_read(view_page *p, struct view_words *out);
/* Sends what there is to send.  link: the bridge's text about the link; link_number counts these texts. */
void view_page_write(view_page *p, view_shelf *shelf, const char *link, uint64_t link_number);
/* Whether the connection is over.  now: mono clock. */
bool view_page_over(view_page *p, int64_t now);
void view_page_close(view_page *p, unsigned code, const char *why);

bool view_page_let_in(const view_page *p);
int64_t view_page_since(const view_page *p); /* mono clock: it was opened then */
bool view_page_closing(const view_page *p);  /* it is being closed, or gone */
bool view_page_refused(const view_page *p);  /* a wrong token, or none in time */
bool view_page_wants_previews(const view_page *p);
bool view_page_looks(const view_page *p); /* let in, and not hidden */
const struct view_page_stats *view_page_stats(const view_page *p);
/* Quantile q of a way's recent times, ms; NAN: there were none, or the clocks differ. */
double view_page_recent(view_page *p, enum view_way way, double q, int64_t now);
/* Call when a volume has come: counts the volume before it, if that was not sent to this page. */
void view_page_count(view_page *p, uint64_t volume_before);
#endif
