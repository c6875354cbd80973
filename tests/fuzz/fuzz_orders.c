/* fuzz_orders.c - any bytes as the daemon's answer to an order of the page's: what the page is told is JSON, and the next
 * order goes out. */
#include <cjson/cJSON.h>
#include <string.h>
#include <unistd.h>

#include "daemon/view/orders.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/fuzz_zmq.h"

static view_orders *orders;
static void *daemon_of; /* where orders come to */

static void begin(void)
{
    char endpoint[64];
    const int patience = 60000;
    snprintf(endpoint, sizeof endpoint, "ipc://@pyrovox-fuzz-orders-%d", (int)getpid());
    daemon_of = zmq_socket(zmq_ctx_new(), ZMQ_REP);
    MUST(zmq_setsockopt(daemon_of, ZMQ_RCVTIMEO, &patience, sizeof patience) == 0);
    MUST(zmq_bind(daemon_of, endpoint) == 0);
    MUST(view_orders_new(endpoint, NULL, &orders, NULL) == PVX_OK);
}

/* {"orders":{...}} of its text, borrowed from *all. */
static const cJSON *said(cJSON **all)
{
    char text[VIEW_ORDER_TEXT + 2];
    snprintf(text, sizeof text, "{%s}", view_orders_text(orders));
    *all = cJSON_Parse(text);
    const cJSON *o = cJSON_GetObjectItem(*all, "orders");
    MUST(o != NULL && cJSON_IsString(cJSON_GetObjectItem(o, "said")));
    return o;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char request[128];
    cJSON *all;
    if (orders == NULL)
        begin();
    do { /* the first may come before the connection does */
        view_orders_give(orders, (enum view_order)(size % VIEW_N_ORDERS));
        (void)view_orders_run(orders);
        said(&all);
        bool busy = cJSON_IsTrue(cJSON_GetObjectItem(cJSON_GetObjectItem(all, "orders"), "busy"));
        cJSON_Delete(all);
        if (busy)
            break;
    } while (usleep(1000) == 0);
    MUST(fuzz_recv(daemon_of, request, sizeof request) > 0);
    MUST(zmq_send(daemon_of, data, size, 0) >= 0);
    while (!view_orders_run(orders))
        continue;
    const cJSON *o = said(&all);
    MUST(cJSON_IsFalse(cJSON_GetObjectItem(o, "busy")));
    fuzz_taken += cJSON_IsTrue(cJSON_GetObjectItem(o, "good")) != 0;
    cJSON_Delete(all);
    return 0;
}
