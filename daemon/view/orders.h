/* orders.h - the little that a page may tell the daemon where `--control` allows it: record volumes, stop that,
 * take a snapshot; as {"cmd":...} of CONTROL.md, one at a time.
 *
 * No name, path or option comes from a page: where things go says the daemon's configuration.
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
/* endpoint: the daemon's control; key: a .key file, or NULL.  Nobody need be there yet.  Errors: those of the key. */
PVX_MUST_CHECK pvx_err view_orders_new(const char *endpoint, const char *key, view_orders **out,
                                       struct pvx_diag *d);
void view_orders_free(view_orders **o);
/* Sends it, unless one is under way: that is said then. */
void view_orders_give(view_orders *o, enum view_order order);
/* Takes the answer, or its absence after a minute; true: the text is another one. */
bool view_orders_run(view_orders *o);
/* "orders":{"asked":2,"busy":false,"good":true,"said":"snapshot: /data/a"}: JSON without braces around, borrowed. */
const char *view_orders_text(const view_orders *o);

#endif
