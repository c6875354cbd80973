/* bridge.h - brings volumes to pages: a source's messages on a shelf, HTTP and WebSockets around it, in one loop.
 *
 * A WebSocket message is a message of PROTOCOL.md as the daemon made it, except that Zstandard data are packed anew
 * as LZ4.  The bridge only subscribes, so the daemon never waits for a page.
 * Threads: all in view_bridge_run.  Memory: the newest message of each kind, and one on its way to each page. */
#ifndef VIEW_BRIDGE_H
#define VIEW_BRIDGE_H
#include "daemon/view/http.h"
#include "daemon/view/orders.h"
#include "daemon/view/page.h"
#include "daemon/view/source.h"

#define VIEW_PAGES_MAX 16
#define VIEW_SEATS \
    (VIEW_PAGES_MAX + 16) /* seats of pages that have yet to show a token are among them */

struct view_bridge_stats {
    struct view_http_stats http;
    struct view_source_stats source;
    uint64_t pages_now, pages_ever, refused_token, refused_full, unreadable;
    struct view_page_stats gone; /* of pages that have left, volumes only */
};
typedef struct view_bridge view_bridge;
#define VIEW_VERDICT_TEXT 1280
/* p: gate, listen, cert and key.  orders NULL: pages can only look.  The bridge owns source and orders from now on,
 * on error too. */
PVX_MUST_CHECK pvx_err view_bridge_new(const struct view_http_params *p,
                                       const struct view_source *source, view_orders *orders,
                                       view_bridge **out, struct pvx_diag *d);
void view_bridge_free(view_bridge **b);
const char *view_bridge_at(const view_bridge *b);
/* Runs until stop returns true (asked five times a second).  say gets one line on what went wrong; may be NULL. */
void view_bridge_run(view_bridge *b, bool (*stop)(void *ctx), void (*say)(const char *line),
                     void *ctx);
/* What pages say of the daemon in one line: `verdict` writes it, given each status message's JSON.  Call before run. */
void view_bridge_verdict(view_bridge *b, void (*verdict)(const char *json, size_t len,
                                                         char out[VIEW_VERDICT_TEXT]));
void view_bridge_stats(const view_bridge *b, struct view_bridge_stats *out);
#endif
