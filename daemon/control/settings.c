/* settings.c - options of a running daemon: read, and changed where it can take another value. */
#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>

#include "daemon/control/commands.h"
#include "daemon/control/json.h"

static size_t settings_unknown(const char *key, struct dmn_answer to)
{
    char text[256];
    snprintf(text, sizeof text, "%.64s: unknown key; the nearest is %s", key,
             dmn_option_nearest(key));
    return dmn_answer_error(to, text);
}

static void settings_option(struct dmn_json *j, const struct dmn_config *c,
                            const struct dmn_option *o)
{
    char *value = dmn_config_value(c, o);
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "key", o->key);
    dmn_json_str(j, "value", value != NULL ? value : "");
    dmn_json_str(j, "default", o->def);
    dmn_json_bool(j, "live", dmn_option_live(o));
    dmn_json_str(j, "unit", o->unit);
    dmn_json_str(j, "help", o->help);
    dmn_json_close(j, '}');
    free(value);
}

size_t dmn_answer_get(const struct dmn_control_ops *ops, const cJSON *request, struct dmn_answer to)
{
    const cJSON *key = cJSON_GetObjectItemCaseSensitive(request, "key");
    const struct dmn_option *one = NULL;
    struct dmn_json j;
    if (ops->config == NULL)
        return dmn_answer_error(to, "options are not known here");
    if (key != NULL && !cJSON_IsString(key))
        return dmn_answer_error(to, "key should be text");
    if (key != NULL && (one = dmn_option_find(key->valuestring)) == NULL)
        return settings_unknown(key->valuestring, to);
    dmn_json_init(&j, to.text, to.size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_bool(&j, "ok", true);
    dmn_json_open(&j, "options", '[');
    for (size_t i = 0; i < dmn_n_options; i++)
        if (one == NULL || one == &dmn_options[i])
            settings_option(&j, ops->config(ops->ctx), &dmn_options[i]);
    dmn_json_close(&j, ']');
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

/* The value as it would stand in the configuration file. */
static bool as_yaml(const cJSON *v, char *out, size_t size)
{
    int n = cJSON_IsString(v)   ? snprintf(out, size, "%s", v->valuestring)
            : cJSON_IsNumber(v) ? snprintf(out, size, "%.17g", v->valuedouble)
            : cJSON_IsBool(v)   ? snprintf(out, size, "%s", cJSON_IsTrue(v) ? "true" : "false")
                                : -1;
    return n >= 0 && (size_t)n < size;
}

static size_t changed(const struct dmn_config *c, const struct dmn_option *o, char *before,
                      struct dmn_answer to)
{
    struct dmn_json j;
    char *value = dmn_config_value(c, o);
    dmn_json_init(&j, to.text, to.size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_bool(&j, "ok", true);
    dmn_json_str(&j, "key", o->key);
    dmn_json_str(&j, "value", value != NULL ? value : "");
    dmn_json_str(&j, "before", before != NULL ? before : "");
    dmn_json_close(&j, '}');
    free(value);
    return dmn_json_end(&j);
}

size_t dmn_answer_set(const struct dmn_control_ops *ops, const cJSON *request, struct dmn_answer to)
{
    static struct dmn_config next; /* the control thread's */
    const char *key = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(request, "key"));
    char value[DMN_WORD_MAX], text[256];
    struct pvx_diag d = {""};
    if (ops->config == NULL || ops->apply == NULL)
        return dmn_answer_error(to, "options cannot be set here");
    if (key == NULL ||
        !as_yaml(cJSON_GetObjectItemCaseSensitive(request, "value"), value, sizeof value))
        return dmn_answer_error(to, "set needs a text \"key\", and a \"value\" that is a text, a "
                                    "number or true or false");
    const struct dmn_option *o = dmn_option_find(key);
    if (o == NULL)
        return settings_unknown(key, to);
    if (!dmn_option_live(o)) {
        snprintf(text, sizeof text,
                 "%s needs a restart: change it in the configuration, and start the daemon again",
                 key);
        return dmn_answer_error(to, text);
    }
    next = *ops->config(ops->ctx);
    pvx_err e = dmn_config_set(&next, key, value, "set", &d);
    char *before = dmn_config_value(ops->config(ops->ctx), o);
    PVX_THEN(e, ops->apply(ops->ctx, &next, &d));
    size_t n =
        e == PVX_OK ? changed(&next, o, before, to) : dmn_answer_error(to, pvx_diag_text(&d, e));
    free(before);
    return n;
}
