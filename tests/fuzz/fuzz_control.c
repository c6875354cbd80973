/* fuzz_control.c - any bytes as a request to the control socket: always a JSON object back. */
#include <cjson/cJSON.h>

#include "base/log.h"
#include "daemon/control/control.h"
#include "tests/fuzz/fuzz.h"

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

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static char reply[DMN_REPLY_MAX];
    const struct dmn_control_ops ops = {.status = status,
                                        .reset_latency = nothing,
                                        .stop = nothing,
                                        .background = take,
                                        .background_state = taken,
                                        .config = in_effect,
                                        .apply = apply};
    if (config.fps == 0)
        dmn_config_defaults(&config);
    size_t n = dmn_control_handle(&ops, data, size, reply, sizeof reply);
    cJSON *j = cJSON_ParseWithLength(reply, n);
    MUST(n >= 2 && n < sizeof reply && cJSON_IsObject(j));
    MUST(size <= DMN_REQUEST_MAX || cJSON_GetObjectItem(j, "error") != NULL);
    cJSON_Delete(j);
    return 0;
}
