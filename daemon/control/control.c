#include "daemon/control/control.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zmq.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "daemon/control/json.h"
#include "proto/ipc.h"

#define WAY_MAX 8 /* a client, and devices between */

struct dmn_control {
    struct dmn_control_ops ops;
    void *zmq, *socket;
    pvp_ipc_claim *claim;
    char *endpoint;
    pvp_auth *auth;
    pvp_zap *zap;
    uint64_t generation; /* of auth, when the socket was opened */
    pthread_t thread;
    bool started;
    atomic_bool quit;
    zmq_msg_t way[WAY_MAX]; /* [n_way] of the request at hand, the empty frame last */
    int n_way;
    char request[DMN_REQUEST_MAX];
    char reply[DMN_REPLY_MAX];
};

static size_t fail(char *reply, size_t size, const char *text)
{
    struct dmn_json j;
    dmn_json_init(&j, reply, size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_str(&j, "error", text);
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

static size_t done(char *reply, size_t size)
{
    return (size_t)snprintf(reply, size, "{\"ok\":true}");
}

static size_t record(const struct dmn_control_ops *ops, const cJSON *req, char *reply, size_t size)
{
    const char *action = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(req, "action"));
    const char *path = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(req, "path"));
    bool start = action != NULL && strcmp(action, "start") == 0;
    if (!start && (action == NULL || strcmp(action, "stop") != 0))
        return fail(reply, size, "action should be \"start\" or \"stop\"");
    if (path != NULL && ops->remote)
        return fail(reply, size, "over the network a take goes to record.path: leave path out");
    if (path != NULL && path[0] != '/')
        return fail(reply, size, "path should be absolute");
    if (ops->record == NULL)
        return fail(reply, size, "recording is not possible here");
    char where[DMN_REQUEST_MAX] = "";
    struct pvx_diag d = {""};
    pvx_err e = ops->record(ops->ctx, start, path, where, sizeof where, &d);
    if (e != PVX_OK)
        return fail(reply, size, pvx_diag_text(&d, e));
    struct dmn_json j;
    dmn_json_init(&j, reply, size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_bool(&j, "ok", true);
    dmn_json_str(&j, "path", where);
    dmn_json_close(&j, '}');
    size_t n = dmn_json_end(&j);
    return n > 0 ? n : done(reply, size);
}

static size_t background_is(const struct dmn_background_state *s, char *reply, size_t size)
{
    struct dmn_json j;
    dmn_json_init(&j, reply, size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_bool(&j, "ok", true);
    dmn_json_int(&j, "request", s->request);
    dmn_json_str(&j, "state", dmn_taking_names[s->state]);
    dmn_json_int(&j, "sets", s->sets);
    dmn_json_int(&j, "have", s->have);
    if (s->state == DMN_TAKING_FAILED)
        dmn_json_str(&j, "why", s->why.text);
    dmn_json_close(&j, '}');
    size_t n = dmn_json_end(&j);
    return n > 0 ? n : fail(reply, size, "no room");
}

static size_t background(const struct dmn_control_ops *ops, const cJSON *req, char *reply,
                         size_t size)
{
    const cJSON *sets = cJSON_GetObjectItemCaseSensitive(req, "sets");
    double n = cJSON_IsNumber(sets) ? sets->valuedouble : -1;
    struct dmn_background_state s = {0};
    struct pvx_diag d = {""};
    if (sets == NULL && ops->background_state != NULL) {
        ops->background_state(ops->ctx, &s);
        return background_is(&s, reply, size);
    }
    if (!(n >= 0 && n <= 1e6 && n == (double)(uint32_t)n))
        return fail(reply, size,
                    "sets should be a whole number, 2 or more, or 0 for no background");
    if (ops->background == NULL)
        return fail(reply, size, "a background is not possible here");
    pvx_err e = ops->background(ops->ctx, (uint32_t)n, &d);
    if (e != PVX_OK)
        return fail(reply, size, pvx_diag_text(&d, e));
    ops->background_state(ops->ctx, &s);
    return (size_t)snprintf(reply, size, "{\"ok\":true,\"request\":%u}", s.request);
}

static size_t command(const struct dmn_control_ops *ops, const cJSON *req, char *reply, size_t size)
{
    const char *cmd = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(req, "cmd"));
    if (cmd == NULL)
        return fail(reply, size, "the request has no text \"cmd\"");
    if (strcmp(cmd, "ping") == 0)
        return (size_t)snprintf(reply, size, "{\"ok\":true,\"pong\":%lld}",
                                (long long)pvx_now_real());
    if (strcmp(cmd, "status") == 0) {
        size_t n = ops->status(ops->ctx, reply, size);
        return n > 0 ? n : fail(reply, size, "the status does not fit into a reply");
    }
    if (strcmp(cmd, "log-level") == 0) {
        const char *word = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(req, "level"));
        enum pvx_log_level level;
        if (word == NULL || pvx_log_level_parse(word, &level) != PVX_OK)
            return fail(reply, size, "level should be \"error\", \"warn\", \"info\" or \"debug\"");
        pvx_log_set_level(level);
        return done(reply, size);
    }
    if (strcmp(cmd, "reset-latency") == 0) {
        ops->reset_latency(ops->ctx);
        return done(reply, size);
    }
    if (strcmp(cmd, "record") == 0)
        return record(ops, req, reply, size);
    if (strcmp(cmd, "background") == 0)
        return background(ops, req, reply, size);
    if (strcmp(cmd, "stop") == 0) {
        ops->stop(ops->ctx);
        return done(reply, size);
    }
    return fail(reply, size,
                "unknown command; there are ping, status, log-level, reset-latency, record, "
                "background, stop");
}

size_t dmn_control_handle(const struct dmn_control_ops *ops, const void *request, size_t len,
                          char *reply, size_t size)
{
    if (len > DMN_REQUEST_MAX)
        return fail(reply, size, "the request is longer than 4096 bytes");
    cJSON *req = cJSON_ParseWithLength(request, len);
    size_t n = cJSON_IsObject(req) ? command(ops, req, reply, size)
                                   : fail(reply, size, "the request is not a JSON object");
    cJSON_Delete(req);
    return n;
}

/* One message: its way back (up to and with the empty frame) and the text after that; what follows is
 * ignored, and so is a message without an empty frame.  The text's true length, -1 = none (errno).
 *
 * A ROUTER, not zmq's REP: in 4.3.4 that one loses its place, and with it the next client's reply, when a
 * message without an empty frame comes from a peer that is gone by then. */
static int receive(dmn_control *c)
{
    int length = -1;
    bool more = true, bottom = false;
    for (c->n_way = 0; more;) {
        zmq_msg_t m;
        zmq_msg_init(&m);
        if (zmq_msg_recv(&m, c->socket, 0) < 0)
            return -1; /* of a message that has begun all frames are there */
        more = zmq_msg_more(&m);
        if (!bottom && c->n_way < WAY_MAX) {
            bottom = zmq_msg_size(&m) == 0;
            zmq_msg_init(&c->way[c->n_way]);
            zmq_msg_move(&c->way[c->n_way++], &m);
        } else if (bottom && length < 0) {
            length = (int)zmq_msg_size(&m);
            memcpy(c->request, zmq_msg_data(&m),
                   (size_t)length < sizeof c->request ? (size_t)length : sizeof c->request);
        }
        zmq_msg_close(&m);
    }
    if (length < 0)
        errno = EAGAIN;
    return length;
}

/* To whom the request came from; nobody if they are gone. */
static void answer(dmn_control *c, size_t length)
{
    bool sent = true;
    for (int k = 0; sent && k < c->n_way; k++)
        sent = zmq_msg_send(&c->way[k], c->socket, ZMQ_SNDMORE | ZMQ_DONTWAIT) >= 0;
    if (!sent || zmq_send(c->socket, c->reply, length, ZMQ_DONTWAIT) < 0)
        LOG_EVERY(PVX_LOG_WARN, DAEMON, "control reply not sent: %s", zmq_strerror(errno));
}

static pvx_err bind_socket(dmn_control *c, struct pvx_diag *d)
{
    int64_t max = DMN_REQUEST_MAX * 4; /* above this libzmq closes the connection */
    int wait_ms = 100, linger = 200;
    c->socket = zmq_socket(c->zmq, ZMQ_ROUTER);
    if (c->socket == NULL)
        return pvx_fail(d, PVX_EIO, "control socket: %s", zmq_strerror(errno));
    zmq_setsockopt(c->socket, ZMQ_MAXMSGSIZE, &max, sizeof max);
    zmq_setsockopt(c->socket, ZMQ_RCVTIMEO, &wait_ms, sizeof wait_ms);
    zmq_setsockopt(c->socket, ZMQ_LINGER, &linger, sizeof linger);
    if (c->auth != NULL)
        PVX_TRY(pvp_auth_guard(c->auth, c->socket, PVP_ROLE_CONTROL));
    if (zmq_bind(c->socket, c->endpoint) != 0)
        return pvp_bind_fail(c->endpoint, errno, d);
    return PVX_OK;
}

/* Somebody may do less than before: all have to come in again (pub.c). */
static void guard_again(dmn_control *c)
{
    struct pvx_diag d = {""};
    if (c->auth == NULL)
        return;
    uint64_t now = pvp_auth_generation(c->auth);
    if (now != c->generation && c->socket != NULL) {
        zmq_close(c->socket);
        c->socket = NULL;
    }
    c->generation = now;
    if (c->socket == NULL && bind_socket(c, &d) != PVX_OK) {
        if (c->socket != NULL)
            zmq_close(c->socket);
        c->socket = NULL;
        usleep(100000);
    }
}

static void *run(void *arg)
{
    dmn_control *c = arg;
    while (!atomic_load(&c->quit)) {
        guard_again(c);
        if (c->socket == NULL)
            continue;
        int n = receive(c);
        if (n >= 0) {
            answer(c,
                   dmn_control_handle(&c->ops, c->request, (size_t)n, c->reply, sizeof c->reply));
        } else if (errno != EAGAIN && errno != EINTR) {
            LOG_E(DAEMON, "control socket: %s; it is closed now", zmq_strerror(errno));
            break;
        }
        for (int k = 0; k < c->n_way; k++)
            zmq_msg_close(&c->way[k]);
    }
    return NULL;
}

pvx_err dmn_control_new(const char *endpoint, pvp_auth *auth, const struct dmn_control_ops *ops,
                        dmn_control **out, struct pvx_diag *d)
{
    *out = NULL;
    dmn_control *c = pvx_calloc(1, sizeof *c);
    if (c == NULL)
        return PVX_ENOMEM;
    c->ops = *ops;
    c->ops.remote = auth != NULL;
    c->auth = auth;
    c->endpoint = strdup(endpoint);
    c->zmq = zmq_ctx_new();
    pvx_err e = c->endpoint != NULL && c->zmq != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK)
        e = pvp_ipc_claim_new(endpoint, &c->claim, d);
    if (e == PVX_OK && auth != NULL) {
        c->generation = pvp_auth_generation(auth);
        e = pvp_zap_new(auth, c->zmq, &c->zap, d);
    }
    if (e == PVX_OK)
        e = bind_socket(c, d);
    if (e == PVX_OK && pthread_create(&c->thread, NULL, run, c) != 0)
        e = pvx_fail(d, PVX_EIO, "control: no thread to be had");
    if (e != PVX_OK) {
        dmn_control_free(&c);
        return e;
    }
    c->started = true;
    pthread_setname_np(c->thread, "control");
    *out = c;
    return PVX_OK;
}

void dmn_control_free(dmn_control **pc)
{
    dmn_control *c = *pc;
    if (c == NULL)
        return;
    atomic_store(&c->quit, true);
    if (c->started)
        pthread_join(c->thread, NULL);
    if (c->socket != NULL)
        zmq_close(c->socket);
    pvp_zap_free(&c->zap);
    if (c->zmq != NULL)
        zmq_ctx_term(c->zmq);
    pvp_ipc_claim_free(&c->claim);
    free(c->endpoint);
    PVX_FREE(*pc);
}
