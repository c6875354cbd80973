#include "daemon/view/orders.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

#include "base/clock.h"
#include "base/mem.h"
#include "proto/attach.h"
#include "proto/auth.h"
#include "proto/door.h"

#define ANSWER_NS (60 * PVX_NS_PER_S) /* a snapshot answers when it is on the disk */
#define SAID_MAX  400                 /* bytes of the daemon's words */

struct view_orders {
    void *zmq, *socket;
    pvp_door *door;
    char *endpoint;
    enum view_order order;
    bool has_key, busy, good, changed;
    int64_t until_ns;
    unsigned asked;
    char said[SAID_MAX], text[VIEW_ORDER_TEXT];
    struct pvx_diag refusal; /* "": the daemon has not refused us since it last took an order */
};

static const struct {
    const char *name, *request;
} orders[VIEW_N_ORDERS] = {
    {"record", "{\"cmd\":\"record\",\"version\":1,\"what\":\"volumes\",\"action\":\"start\"}"},
    {"stop", "{\"cmd\":\"record\",\"version\":1,\"what\":\"volumes\",\"action\":\"stop\"}"},
    {"snapshot", "{\"cmd\":\"snapshot\",\"version\":1}"}};

enum view_order view_order_of(const char *name)
{
    int i = 0;
    while (i < VIEW_N_ORDERS && strcmp(name, orders[i].name) != 0)
        i++;
    return (enum view_order)i;
}

static void orders_say(view_orders *o, bool good, const char *words)
{
    o->good = good;
    o->changed = true;
    snprintf(o->said, sizeof o->said, "%s: %s", orders[o->order].name, words);
    cJSON *j = cJSON_CreateObject(), *in = cJSON_AddObjectToObject(j, "orders");
    cJSON_AddNumberToObject(in, "asked", o->asked);
    cJSON_AddBoolToObject(in, "busy", o->busy);
    cJSON_AddBoolToObject(in, "good", good);
    cJSON_AddStringToObject(in, "said", o->asked > 0 ? o->said : "");
    char text[VIEW_ORDER_TEXT + 2] = "{}";
    if (!cJSON_PrintPreallocated(j, text, sizeof text, false)) /* many control characters */
        snprintf(text, sizeof text,
                 "{\"orders\":{\"asked\":%u,\"busy\":%s,\"good\":%s,\"said\":\"\"}}", o->asked,
                 o->busy ? "true" : "false", good ? "true" : "false");
    cJSON_Delete(j);
    snprintf(o->text, sizeof o->text, "%.*s", (int)strlen(text) - 2, text + 1);
}

pvx_err view_orders_new(const char *endpoint, const char *key, view_orders **out,
                        struct pvx_diag *d)
{
    const int zero = 0, one = 1;
    view_orders *o = *out = pvx_calloc(1, sizeof *o);
    PVX_NEED(o);
    o->zmq = zmq_ctx_new();
    o->socket = o->zmq != NULL ? zmq_socket(o->zmq, ZMQ_REQ) : NULL;
    o->endpoint = strdup(endpoint);
    o->has_key = key != NULL;
    pvx_err e = o->socket != NULL && o->endpoint != NULL ? PVX_OK : PVX_ENOMEM;
    PVX_THEN(e, pvp_door_new(o->zmq, o->socket, &o->door));
    if (e == PVX_OK && key != NULL)
        e = pvp_auth_client(o->socket, key, d);
    if (e == PVX_OK) {
        /* An answer to an order that was given up is not taken for one to a later order.  No order waits for a
         * daemon that is not there. */
        zmq_setsockopt(o->socket, ZMQ_REQ_RELAXED, &one, sizeof one);
        zmq_setsockopt(o->socket, ZMQ_REQ_CORRELATE, &one, sizeof one);
        zmq_setsockopt(o->socket, ZMQ_IMMEDIATE, &one, sizeof one);
        zmq_setsockopt(o->socket, ZMQ_LINGER, &zero, sizeof zero);
        if (pvp_connect(o->socket, endpoint) != 0)
            e = pvx_fail(d, PVX_EINVAL, "--control %s: %s", endpoint, zmq_strerror(errno));
    }
    if (e != PVX_OK)
        view_orders_free(out);
    else
        orders_say(o, true, "");
    return e;
}

void view_orders_free(view_orders **o)
{
    if (*o == NULL)
        return;
    pvp_door_free(&(*o)->door);
    free((*o)->endpoint);
    if ((*o)->socket != NULL)
        zmq_close((*o)->socket);
    if ((*o)->zmq != NULL)
        zmq_ctx_term((*o)->zmq);
    PVX_FREE(*o);
}

/* Note that the daemon has refused us.  An order that is under way then still waits for its minute. */
static void look_at_door(view_orders *o)
{
    struct pvx_diag why = {""};
    if (pvp_door_refused(o->door, o->endpoint, o->has_key, &why) != PVX_OK)
        o->refusal = why;
}

void view_orders_give(view_orders *o, enum view_order order)
{
    if (o->busy) {
        orders_say(o, false, "not done yet, one thing at a time");
        return;
    }
    o->order = order;
    o->asked++;
    const char *r = orders[order].request;
    o->busy = zmq_send(o->socket, r, strlen(r), ZMQ_DONTWAIT) >= 0;
    o->until_ns = pvx_now_mono() + ANSWER_NS;
    look_at_door(o);
    if (o->busy) {
        o->refusal.text[0] = '\0';
        orders_say(o, true, "asked");
    } else {
        orders_say(o, false,
                   o->refusal.text[0] != '\0'
                       ? o->refusal.text
                       : "no daemon takes orders there: is it running, and is "
                         "--control its control.endpoint?");
    }
}

/* Turn the daemon's answer to the order into the text. */
static void answered(view_orders *o, const char *text, size_t len)
{
    cJSON *j = cJSON_ParseWithLength(text, len);
    const char *error = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(j, "error"));
    const char *path = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(j, "path"));
    bool good = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(j, "ok")) != 0;
    orders_say(o, good,
               error != NULL  ? error
               : !good        ? "the daemon's answer is not understood"
               : path != NULL ? path
                              : "done");
    cJSON_Delete(j);
}

bool view_orders_run(view_orders *o)
{
    zmq_msg_t m;
    zmq_msg_init(&m);
    look_at_door(o);
    if (o->busy && zmq_msg_recv(&m, o->socket, ZMQ_DONTWAIT) >= 0) {
        o->busy = false;
        answered(o, zmq_msg_data(&m), zmq_msg_size(&m));
    } else if (o->busy && pvx_now_mono() > o->until_ns) {
        o->busy = false;
        orders_say(o, false, "the daemon does not answer");
    }
    zmq_msg_close(&m);
    bool changed = o->changed;
    o->changed = false;
    return changed;
}

const char *view_orders_text(const view_orders *o)
{
    return o->text;
}
