/* fuzz_control.c - any bytes as a request to the control socket: always a JSON object back.
 * An input that begins with a byte 0 goes through the socket itself, as frames, each after a byte of its length; one that
 * begins with a blank is as from another host, which may not say where a file goes. */
#include <cjson/cJSON.h>
#include <string.h>
#include <unistd.h>

#include "base/log.h"
#include "daemon/control/control.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/fuzz_zmq.h"

#define WAY \
    7 /* frames before the request, the empty one too, that an answer finds its way back through */
#define FRAMES 12

static size_t status(void *ctx, char *out, size_t size)
{
    (void)ctx;
    return (size_t)snprintf(out, size, "{\"sets_per_s\":20}");
}
static void nothing(void *ctx)
{
    (void)ctx;
}

static uint32_t asked;
static pvx_err take(void *ctx, uint32_t sets, struct pvx_diag *d)
{
    (void)ctx;
    asked = sets;
    return sets == 1 ? pvx_fail(d, PVX_EINVAL, "one") : PVX_OK;
}
static void taken(void *ctx, struct dmn_background_state *out)
{
    (void)ctx;
    *out = (struct dmn_background_state){.request = 1, .sets = asked};
    out->state = (enum dmn_taking)(asked % 4);
}

static struct dmn_config config;
static const struct dmn_config *in_effect(void *ctx)
{
    (void)ctx;
    return &config;
}
static pvx_err apply(void *ctx, const struct dmn_config *c, struct pvx_diag *d)
{
    (void)ctx;
    (void)d;
    MUST(c->compress >= 0 && c->compress <= 2 && c->margin >= 0 && c->margin <= 100);
    return PVX_OK;
}

static struct dmn_control_ops ops;
static pvx_err written(void *ctx, const char *file, char *where, size_t size, struct pvx_diag *d)
{
    (void)ctx;
    MUST(file == NULL || (file[0] == '/' && !ops.remote) ||
         (file[0] != '\0' && file[0] != '.' && strchr(file, '/') == NULL));
    snprintf(where, size, "%s", file != NULL ? file : "/data/a");
    return file != NULL && file[0] == 'f' ? pvx_fail(d, PVX_ENOSPC, "%s: full", file) : PVX_OK;
}
static pvx_err record(void *ctx, bool start, const char *file, char *where, size_t size,
                      struct pvx_diag *d)
{
    (void)start;
    return written(ctx, file, where, size, d);
}
static pvx_err record_volumes(void *ctx, bool start, char *where, size_t size, struct pvx_diag *d)
{
    return written(ctx, start ? NULL : "full", where, size, d);
}
static pvx_err reload_keys(void *ctx, struct pvx_diag *d)
{
    (void)ctx;
    return pvx_fail(d, PVX_EFORMAT, "keys: %s", "none");
}

static void *socket_to_it;
static void begin(void)
{
    static dmn_control *c; /* as long as the program */
    char endpoint[64];
    const int patience = 60000;
    pvx_log_set_level(PVX_LOG_ERROR);
    dmn_config_defaults(&config);
    ops = (struct dmn_control_ops){.status = status,
                                   .reset_latency = nothing,
                                   .stop = nothing,
                                   .record = record,
                                   .record_volumes = record_volumes,
                                   .snapshot = written,
                                   .background = take,
                                   .background_state = taken,
                                   .config = in_effect,
                                   .apply = apply,
                                   .reload_keys = reload_keys};
    snprintf(endpoint, sizeof endpoint, "ipc://@pyrovox-fuzz-%d", (int)getpid());
    MUST(dmn_control_new(endpoint, NULL, &ops, &c, NULL) == PVX_OK);
    socket_to_it = zmq_socket(zmq_ctx_new(), ZMQ_DEALER);
    MUST(zmq_setsockopt(socket_to_it, ZMQ_RCVTIMEO, &patience, sizeof patience) == 0);
    MUST(zmq_connect(socket_to_it, endpoint) == 0);
}

static void answered(const char *reply, size_t n)
{
    cJSON *j = cJSON_ParseWithLength(reply, n);
    MUST(n >= 2 && cJSON_IsObject(j));
    fuzz_taken += cJSON_IsTrue(cJSON_GetObjectItem(j, "ok")) != 0;
    cJSON_Delete(j);
}

/* What has an empty frame and one behind it is answered by the same frames and a text; anything else by nothing. */
static void frames(const uint8_t *data, size_t size)
{
    static char reply[DMN_REPLY_MAX];
    const uint8_t *frame[FRAMES];
    size_t len[FRAMES];
    int n = 0, bottom = 0;
    for (size_t at = 0; at < size && n < FRAMES; n++) {
        size_t l = data[at++];
        frame[n] = data + at;
        len[n] = l < size - at ? l : size - at;
        at += len[n];
    }
    for (int i = 0; i < n; i++)
        MUST(zmq_send(socket_to_it, frame[i], len[i], i < n - 1 ? ZMQ_SNDMORE : 0) >= 0);
    while (bottom < n && len[bottom] > 0)
        bottom++;
    if (bottom >= WAY || bottom + 1 >= n)
        return;
    for (int i = 0; i <= bottom; i++)
        MUST(fuzz_recv(socket_to_it, reply, sizeof reply) == (int)len[i] &&
             memcmp(reply, frame[i], len[i]) == 0);
    int l = fuzz_recv(socket_to_it, reply, sizeof reply);
    MUST(l >= 0 && l < (int)sizeof reply);
    answered(reply, (size_t)l);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static char reply[DMN_REPLY_MAX];
    if (socket_to_it == NULL)
        begin();
    ops.remote = size > 0 && data[0] == ' ';
    if (size > 0 && data[0] == 0) {
        frames(data + 1, size - 1);
        return 0;
    }
    size_t n = dmn_control_handle(&ops, data, size, reply, sizeof reply);
    MUST(n < sizeof reply);
    answered(reply, n);
    MUST(size <= DMN_REQUEST_MAX || strstr(reply, "\"error\"") != NULL);
    return 0;
}
