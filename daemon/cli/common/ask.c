#include "daemon/cli/common/ask.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

#include "base/clock.h"
#include "daemon/control/commands.h"
#include "proto/attach.h"
#include "proto/auth.h"
#include "proto/door.h"

#define ANSWER_MS 5000
#define SAY_MS    1000  /* after this time print that the wait may be long */
#define WRITE_MS  60000 /* record stop and snapshot answer when all is written */

/* The daemon that is asked, and the key for it. */
struct whom {
    const char *endpoint, *key;
    bool patient; /* the answer may take long: print that */
};

/* Wait until an answer can be read or the time is over.  Fails early if the daemon refuses the key. */
static pvx_err ask_answer(void *socket, pvp_door *door, struct whom whom, int timeout_ms,
                          struct pvx_diag *d)
{
    zmq_pollitem_t item[] = {{.socket = socket, .events = ZMQ_POLLIN},
                             {.socket = pvp_door_socket(door), .events = ZMQ_POLLIN}};
    for (int64_t until = pvx_now_mono() + timeout_ms * PVX_NS_PER_MS;;) {
        int64_t left = (until - pvx_now_mono()) / PVX_NS_PER_MS;
        bool brief = whom.patient && left > SAY_MS;
        int n = zmq_poll(item, 2, brief ? SAY_MS : left > 0 ? (long)left : 0);
        if (n < 0 && errno == EINTR)
            return PVX_ECANCELED;
        if (n == 0 && brief) {
            fprintf(stderr,
                    "waiting for a daemon at %s to answer (`pyrovox status` tells if one runs); "
                    "Ctrl-C stops\n",
                    whom.endpoint);
            whom.patient = false;
            continue;
        }
        if (n <= 0 || (item[0].revents & ZMQ_POLLIN) != 0)
            return PVX_OK; /* reading the socket tells whether there is an answer */
        PVX_TRY(pvp_door_refused(door, whom.endpoint, whom.key != NULL, d));
    }
}

static pvx_err ask_reach(void *socket, const char *endpoint, const char *key, int timeout_ms,
                         struct pvx_diag *d)
{
    int linger = 0;
    zmq_setsockopt(socket, ZMQ_LINGER, &linger, sizeof linger);
    zmq_setsockopt(socket, ZMQ_RCVTIMEO, &timeout_ms, sizeof timeout_ms);
    zmq_setsockopt(socket, ZMQ_SNDTIMEO, &timeout_ms, sizeof timeout_ms);
    if (key != NULL)
        PVX_TRY(pvp_auth_client(socket, key, d));
    if (pvp_connect(socket, endpoint) != 0)
        return pvx_fail(d, PVX_EINVAL, "%s: %s", endpoint, zmq_strerror(errno));
    return PVX_OK;
}

static pvx_err exchange(void *socket, pvp_door *door, struct whom whom, const char *text,
                        int timeout_ms, cJSON **out, struct pvx_diag *d)
{
    const char *endpoint = whom.endpoint, *key = whom.key;
    PVX_TRY(ask_reach(socket, endpoint, key, timeout_ms, d));
    zmq_msg_t reply;
    zmq_msg_init(&reply);
    pvx_err e = PVX_OK;
    int sent = zmq_send(socket, text, strlen(text), 0);
    if (sent >= 0)
        e = ask_answer(socket, door, whom, timeout_ms, d);
    if (e != PVX_OK) {
        /* the error is in d already */
    } else if (sent < 0 || zmq_msg_recv(&reply, socket, ZMQ_DONTWAIT) < 0) {
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
    return ask_words(endpoint, key, (const char *const[]){cmd, NULL}, timeout_ms, out, d);
}

static pvx_err put_to(struct whom whom, const char *text, int timeout_ms, cJSON **out,
                      struct pvx_diag *d)
{
    *out = NULL;
    void *zmq = zmq_ctx_new();
    void *socket = zmq == NULL ? NULL : zmq_socket(zmq, ZMQ_REQ);
    pvp_door *door = NULL;
    pvx_err e = socket == NULL ? PVX_ENOMEM : pvp_door_new(zmq, socket, &door);
    PVX_THEN(e, exchange(socket, door, whom, text, timeout_ms, out, d));
    pvp_door_free(&door);
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

pvx_err ask_request(const char *endpoint, const char *key, const char *text, int timeout_ms,
                    cJSON **out, struct pvx_diag *d)
{
    return put_to((struct whom){endpoint, key, false}, text, timeout_ms, out, d);
}

/* Add word number i to a request.  Its key is the i-th of the command's keys.  Key `what` may be left out, and a name
 * that begins with / is a path.  false: one word too many. */
static bool add_word(cJSON *request, const struct dmn_command *k, int i, const char *word)
{
    char key[32] = "", *end = NULL;
    const char *p = k->keys;
    for (int skip = 1; skip < i && *p != '\0'; skip++) {
        p += strcspn(p, " ");
        p += *p == ' ';
    }
    snprintf(key, sizeof key, "%.*s", (int)strcspn(p, " "), p);
    if (strcmp(key, "what") == 0 && strcmp(word, "raw") != 0 && strcmp(word, "volumes") != 0)
        snprintf(key, sizeof key, "name");
    if (key[0] == '\0' || strcmp(key, "path") == 0 ||
        (strcmp(key, "name") == 0 && (cJSON_HasObjectItem(request, "name") || /* two */
                                      cJSON_HasObjectItem(request, "path"))))
        return false;
    if (strcmp(key, "name") == 0 && word[0] == '/')
        snprintf(key, sizeof key, "path");
    double number =
        strcmp(key, "sets") == 0 || strcmp(key, "request") == 0 ? strtod(word, &end) : 0;
    if (end != NULL && end != word && *end == '\0')
        cJSON_AddNumberToObject(request, key, number);
    else
        cJSON_AddStringToObject(request, key, word);
    return true;
}

pvx_err ask_words(const char *endpoint, const char *key, const char *const *word, int timeout_ms,
                  cJSON **out, struct pvx_diag *d)
{
    const struct dmn_command *k = dmn_command_find(word[0]);
    cJSON *request = cJSON_CreateObject();
    bool writes = strcmp(k->name, "record") == 0 || strcmp(k->name, "snapshot") == 0;
    *out = NULL;
    cJSON_AddStringToObject(request, "cmd", k->name);
    cJSON_AddNumberToObject(request, "version", DMN_CONTROL_VERSION);
    pvx_err e = PVX_OK;
    for (int i = 1; e == PVX_OK && word[i] != NULL; i++)
        e = add_word(request, k, i, word[i])
                ? PVX_OK
                : pvx_fail(d, PVX_ERANGE, "usage: pyrovox ctl %s %s", k->name, k->usage);
    char *text = cJSON_PrintUnformatted(request);
    cJSON_Delete(request);
    if (text == NULL)
        e = PVX_ENOMEM;
    if (e == PVX_OK)
        e = put_to((struct whom){endpoint, key, writes}, text,
                   timeout_ms > 0 ? timeout_ms
                   : writes       ? WRITE_MS
                                  : ANSWER_MS,
                   out, d);
    free(text);
    return e;
}

static const cJSON *ask_at(const cJSON *j, const char *a, const char *b)
{
    const cJSON *v = cJSON_GetObjectItemCaseSensitive(j, a);
    return b == NULL ? v : cJSON_GetObjectItemCaseSensitive(v, b);
}

double ask_num(const cJSON *j, const char *a, const char *b)
{
    const cJSON *v = ask_at(j, a, b);
    return cJSON_IsNumber(v) ? v->valuedouble : 0;
}

const char *ask_text(const cJSON *j, const char *a, const char *b)
{
    const char *s = cJSON_GetStringValue(ask_at(j, a, b));
    return s == NULL ? "" : s;
}
