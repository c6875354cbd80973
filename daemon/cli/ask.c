#include "daemon/cli/ask.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <zmq.h>

#include "proto/auth.h"

static pvx_err exchange(void *socket, const char *endpoint, const char *key, const char *text,
                        int timeout_ms, cJSON **out, struct pvx_diag *d)
{
    int linger = 0;
    zmq_setsockopt(socket, ZMQ_LINGER, &linger, sizeof linger);
    zmq_setsockopt(socket, ZMQ_RCVTIMEO, &timeout_ms, sizeof timeout_ms);
    zmq_setsockopt(socket, ZMQ_SNDTIMEO, &timeout_ms, sizeof timeout_ms);
    if (key != NULL)
        PVX_TRY(pvp_auth_client(socket, key, d));
    if (zmq_connect(socket, endpoint) != 0)
        return pvx_fail(d, PVX_EINVAL, "%s: %s", endpoint, zmq_strerror(errno));
    zmq_msg_t reply;
    zmq_msg_init(&reply);
    pvx_err e = PVX_OK;
    if (zmq_send(socket, text, strlen(text), 0) < 0 || zmq_msg_recv(&reply, socket, 0) < 0) {
        e = errno == EINTR
                ? PVX_ECANCELED
                : pvx_fail(d, PVX_ETIMEDOUT,
                           "%s: no daemon answers; is pyrovoxd running, "
                           "and with this control.endpoint%s?",
                           endpoint, key != NULL ? ", its key and this one in its list" : "");
    } else {
        *out = cJSON_ParseWithLength(zmq_msg_data(&reply), zmq_msg_size(&reply));
        if (!cJSON_IsObject(*out))
            e = pvx_fail(d, PVX_EFORMAT, "%s: the answer is not a JSON object", endpoint);
        else if (ask_text(*out, "error", NULL)[0] != '\0')
            e = pvx_fail(d, PVX_EINVAL, "%s: %s", endpoint, ask_text(*out, "error", NULL));
    }
    zmq_msg_close(&reply);
    return e;
}

pvx_err ask(const char *endpoint, const char *key, const char *cmd, int timeout_ms, cJSON **out,
            struct pvx_diag *d)
{
    char text[256];
    snprintf(text, sizeof text, "{\"cmd\":\"%s\"}", cmd);
    return ask_request(endpoint, key, text, timeout_ms, out, d);
}

pvx_err ask_request(const char *endpoint, const char *key, const char *request, int timeout_ms,
                    cJSON **out, struct pvx_diag *d)
{
    *out = NULL;
    void *zmq = zmq_ctx_new();
    void *socket = zmq == NULL ? NULL : zmq_socket(zmq, ZMQ_REQ);
    pvx_err e =
        socket == NULL ? PVX_ENOMEM : exchange(socket, endpoint, key, request, timeout_ms, out, d);
    if (socket != NULL)
        zmq_close(socket);
    if (zmq != NULL)
        zmq_ctx_term(zmq);
    if (e != PVX_OK) {
        cJSON_Delete(*out);
        *out = NULL;
    }
    return e;
}

static const cJSON *at(const cJSON *j, const char *a, const char *b)
{
    const cJSON *v = cJSON_GetObjectItemCaseSensitive(j, a);
    return b == NULL ? v : cJSON_GetObjectItemCaseSensitive(v, b);
}

double ask_num(const cJSON *j, const char *a, const char *b)
{
    const cJSON *v = at(j, a, b);
    return cJSON_IsNumber(v) ? v->valuedouble : 0;
}

const char *ask_text(const cJSON *j, const char *a, const char *b)
{
    const char *s = cJSON_GetStringValue(at(j, a, b));
    return s == NULL ? "" : s;
}
