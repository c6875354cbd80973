/* orders.h - the few orders that a page may give to the daemon if `--control` allows it: record volumes, stop that,
 * take a snapshot.  Each is a {"cmd":...} of CONTROL.md, one at a time.
 *
 * No name, path or option comes from a page.  The daemon's configuration says where things go.
 * Threads: one. */
#ifndef VIEW_ORDERS_H
#define VIEW_ORDERS_H
#include <stdbool.h>
#include <stddef.h>
#include "base/err.h"

enum view_order { VIEW_ORDER_RECORD, VIEW_ORDER_STOP, VIEW_ORDER_SNAPSHOT, VIEW_N_ORDERS };
/* "record" "stop" "snapshot"; VIEW_N_ORDERS: none of them. */
enum view_order view_order_of(const char *name);

#define VIEW_ORDER_TEXT 700 /* bytes */

typedef struct view_orders view_orders;
/* endpoint: the daemon's control, which need not be there yet; key: a .key file, or NULL.  Errors: those of the
 * key. */
PVX_MUST_CHECK pvx_err view_orders_new(const char *endpoint, const char *key, view_orders **out,
                                       struct pvx_diag *d);
void view_orders_free(view_orders **o);
/* Sends the order.  If one is under way, the text says so instead. */
void view_orders_give(view_orders *o, enum view_order order);
/* Takes the answer, or gives it up after a minute; true: the text has changed. */
bool view_orders_run(view_orders *o);
/* "orders":{"asked":2,"busy":false,"good":true,"said":"snapshot: /data/a"}: JSON without braces around, borrowed. */
const char *view_orders_text(const view_orders *o);

#endif
