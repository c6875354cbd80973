/* commands.c - the requests of the control socket and their answers. */
#include "daemon/control/commands.h"

#include <cjson/cJSON.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "base/clock.h"
#include "base/log.h"
#include "daemon/control/json.h"

#define OPS const struct dmn_control_ops *ops, const cJSON *request, struct dmn_answer to

static const char *commands_text_of(const cJSON *request, const char *key)
{
    return cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(request, key));
}

size_t dmn_answer_error(struct dmn_answer to, const char *text)
{
    struct dmn_json j;
    dmn_json_init(&j, to.text, to.size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_str(&j, "error", text);
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

static size_t commands_done(struct dmn_answer to)
{
    return (size_t)snprintf(to.text, to.size, "{\"ok\":true}");
}

static size_t ping(OPS)
{
    (void)ops;
    (void)request;
    return (size_t)snprintf(to.text, to.size, "{\"ok\":true,\"pong\":%lld}",
                            (long long)pvx_now_real());
}

static size_t status(OPS)
{
    (void)request;
    size_t n = ops->status(ops->ctx, to.text, to.size);
    return n > 0 ? n : dmn_answer_error(to, "the status does not fit into a reply");
}

static size_t log_level(OPS)
{
    const char *word = commands_text_of(request, "level");
    enum pvx_log_level level;
    if (word == NULL || pvx_log_level_parse(word, &level) != PVX_OK)
        return dmn_answer_error(to, "level should be \"error\", \"warn\", \"info\" or \"debug\"");
    if (ops->config != NULL && ops->apply != NULL) {
        static struct dmn_config next; /* the control thread's */
        struct pvx_diag d = {""};
        next = *ops->config(ops->ctx);
        next.log_level = (int)level;
        pvx_err e = ops->apply(ops->ctx, &next, &d);
        return e == PVX_OK ? commands_done(to) : dmn_answer_error(to, pvx_diag_text(&d, e));
    }
    pvx_log_set_level(level);
    return commands_done(to);
}

static size_t reset_latency(OPS)
{
    (void)request;
    ops->reset_latency(ops->ctx);
    return commands_done(to);
}

static size_t commands_stop(OPS)
{
    (void)request;
    ops->stop(ops->ctx);
    return commands_done(to);
}

static size_t reload_keys(OPS)
{
    struct pvx_diag d = {""};
    (void)request;
    if (ops->reload_keys == NULL)
        return dmn_answer_error(to, "there are no keys here");
    pvx_err e = ops->reload_keys(ops->ctx, &d);
    return e == PVX_OK ? commands_done(to) : dmn_answer_error(to, pvx_diag_text(&d, e));
}

/* The file of a request: a whole path; a name in the folder of record.path; or NULL, as configured.  false: *why. */
static bool which_file(const struct dmn_control_ops *ops, const cJSON *request, const char **file,
                       const char **why)
{
    const char *path = commands_text_of(request, "path"), *name = commands_text_of(request, "name");
    *file = path != NULL ? path : name;
    *why = path != NULL && name != NULL  ? "path or name, not both"
           : path != NULL && ops->remote ? "over the network it goes to the folder of record.path: "
                                           "leave path out, or give a name"
           : path != NULL && path[0] != '/' ? "path should be absolute"
           : name != NULL && (name[0] == '\0' || name[0] == '.' || strchr(name, '/') != NULL)
               ? "name should be that of a file, without a folder and not beginning with a dot"
               : NULL;
    return *why == NULL;
}

static size_t done_there(const char *path, struct dmn_answer to)
{
    struct dmn_json j;
    dmn_json_init(&j, to.text, to.size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_bool(&j, "ok", true);
    dmn_json_str(&j, "path", path);
    dmn_json_close(&j, '}');
    size_t n = dmn_json_end(&j);
    return n > 0 ? n : commands_done(to);
}

static size_t record(OPS)
{
    const char *action = commands_text_of(request, "action"),
               *what = commands_text_of(request, "what"), *file, *why;
    bool start = action != NULL && strcmp(action, "start") == 0;
    bool volumes = what != NULL && strcmp(what, "volumes") == 0;
    if (what != NULL && !volumes && strcmp(what, "raw") != 0)
        return dmn_answer_error(to, "what should be \"raw\" or \"volumes\"");
    if (!start && (action == NULL || strcmp(action, "stop") != 0))
        return dmn_answer_error(to, "action should be \"start\" or \"stop\"");
    if (!which_file(ops, request, &file, &why))
        return dmn_answer_error(to, why);
    if (volumes && file != NULL)
        return dmn_answer_error(to, "volumes go to record.volumes_path: leave path and name out");
    if (volumes ? ops->record_volumes == NULL : ops->record == NULL)
        return dmn_answer_error(to, "recording is not possible here");
    char where[DMN_REQUEST_MAX] = "";
    struct pvx_diag d = {""};
    pvx_err e = volumes ? ops->record_volumes(ops->ctx, start, where, sizeof where, &d)
                        : ops->record(ops->ctx, start, file, where, sizeof where, &d);
    return e == PVX_OK ? done_there(where, to) : dmn_answer_error(to, pvx_diag_text(&d, e));
}

static size_t commands_trigger(OPS)
{
    const char *name = commands_text_of(request, "name");
    int64_t t_ns = 0;
    struct pvx_diag d = {""};
    struct dmn_json j;
    if (cJSON_HasObjectItem(request, "name") && name == NULL)
        return dmn_answer_error(to, "name should be the text of a trigger's name");
    if (ops->trigger == NULL)
        return dmn_answer_error(to, "a trigger is not possible here");
    pvx_err e = ops->trigger(ops->ctx, name, &t_ns, &d);
    if (e != PVX_OK)
        return dmn_answer_error(to, pvx_diag_text(&d, e));
    time_t s = (time_t)(t_ns / PVX_NS_PER_S);
    struct tm tm;
    char when[40] = "";
    if (gmtime_r(&s, &tm) != NULL)
        strftime(when, sizeof when, "%Y-%m-%dT%H:%M:%SZ", &tm);
    dmn_json_init(&j, to.text, to.size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_bool(&j, "ok", true);
    dmn_json_int(&j, "t_ns", t_ns);
    dmn_json_str(&j, "instant", when);
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

static size_t commands_snapshot(OPS)
{
    const char *file, *why;
    char where[DMN_REQUEST_MAX] = "";
    struct pvx_diag d = {""};
    if (!which_file(ops, request, &file, &why))
        return dmn_answer_error(to, why);
    if (ops->snapshot == NULL)
        return dmn_answer_error(to, "a snapshot is not possible here");
    pvx_err e = ops->snapshot(ops->ctx, file, where, sizeof where, &d);
    return e == PVX_OK ? done_there(where, to) : dmn_answer_error(to, pvx_diag_text(&d, e));
}

/* Begin and end the answer about something that was asked for. */
static void taking_open(struct dmn_json *j, struct dmn_answer to, unsigned request,
                        enum dmn_taking state)
{
    dmn_json_init(j, to.text, to.size);
    dmn_json_open(j, NULL, '{');
    dmn_json_bool(j, "ok", true);
    dmn_json_int(j, "request", request);
    dmn_json_str(j, "state", dmn_taking_names[state]);
}

static size_t taking_close(struct dmn_json *j, struct dmn_answer to, enum dmn_taking state,
                           const struct pvx_diag *why)
{
    if (state == DMN_TAKING_FAILED)
        dmn_json_str(j, "why", why->text);
    dmn_json_close(j, '}');
    size_t n = dmn_json_end(j);
    return n > 0 ? n : dmn_answer_error(to, "no room");
}

static size_t background_is(const struct dmn_background_state *s, struct dmn_answer to)
{
    struct dmn_json j;
    taking_open(&j, to, s->request, s->state);
    dmn_json_int(&j, "sets", s->sets);
    dmn_json_int(&j, "have", s->have);
    return taking_close(&j, to, s->state, &s->why);
}

static size_t background(OPS)
{
    const cJSON *sets = cJSON_GetObjectItemCaseSensitive(request, "sets");
    double n = cJSON_IsNumber(sets) ? sets->valuedouble : -1;
    struct dmn_background_state s = {0};
    struct pvx_diag d = {""};
    if (sets == NULL && ops->background_state != NULL) {
        ops->background_state(ops->ctx, &s);
        return background_is(&s, to);
    }
    if (!(n >= 0 && n <= 1e6 && n == (double)(uint32_t)n))
        return dmn_answer_error(to,
                                "sets should be a whole number, 2 or more, or 0 for no background");
    if (ops->background == NULL)
        return dmn_answer_error(to, "a background is not possible here");
    pvx_err e = ops->background(ops->ctx, (uint32_t)n, &d);
    if (e != PVX_OK)
        return dmn_answer_error(to, pvx_diag_text(&d, e));
    ops->background_state(ops->ctx, &s);
    return (size_t)snprintf(to.text, to.size, "{\"ok\":true,\"request\":%u}", s.request);
}

static size_t check_is(const struct dmn_check_request *s, struct dmn_answer to)
{
    struct dmn_json j;
    taking_open(&j, to, s->request, s->state);
    if (s->state == DMN_TAKING_DONE)
        dmn_belong_json(&j, &s->found, s->camera, s->n_cameras);
    return taking_close(&j, to, s->state, &s->why);
}

/* Without a number it begins one; a check that is under way serves all who ask. */
static size_t check(OPS)
{
    static struct dmn_check_request s; /* the control thread's */
    struct pvx_diag d = {""};
    if (ops->check == NULL)
        return dmn_answer_error(to, "a check is not possible here");
    if (!cJSON_HasObjectItem(request, "request")) {
        pvx_err e = ops->check(ops->ctx, &d);
        if (e != PVX_OK)
            return dmn_answer_error(to, pvx_diag_text(&d, e));
    }
    ops->check_state(ops->ctx, &s);
    return check_is(&s, to);
}

const struct dmn_command dmn_commands[] = {
    {"ping", "", "", "is it there", ping},
    {"status", "", "", "all that the daemon knows of itself (`pyrovox status`)", status},
    {"get", "key", "[KEY]", "an option, or all: value, default, whether it can be set",
     dmn_answer_get},
    {"set", "key value", "KEY VALUE",
     "another value from the next frame set on; log_level, solver.* but solver.name, photometry.*, "
     "publish.compress",
     dmn_answer_set},
    {"log-level", "level", "error|warn|info|debug", "as set log_level", log_level},
    {"record", "action what name path", "start|stop [raw|volumes] [NAME|/PATH]",
     "a take of raw frames, a NAME goes to the folder of record.path; or a recording of volumes, "
     "which goes to record.volumes_path",
     record},
    {"trigger", "name", "[NAME]",
     "a take of the raw frames in memory (record.ring) around now; a NAME of `triggers` in "
     "pyrovoxd.yaml gives how long before and after",
     commands_trigger},
    {"snapshot", "name path", "[NAME|/PATH]",
     "one frame set, the volume made of it and the status into a folder, to look at later or to "
     "send to somebody; a NAME is beside record.path",
     commands_snapshot},
    {"background", "sets", "[SETS]",
     "subtract the mean of the next SETS from then on, 0: no more; without: how far it is",
     background},
    {"check", "request", "",
     "do pictures and rig belong together: tries swapped, mirrored and late cameras, other "
     "readings "
     "of the rig, a larger volume; the verdict, and exit 1 if it is bad",
     check},
    {"reset-latency", "", "", "the latency statistics start anew", reset_latency},
    {"reload-keys", "", "", "read keys.server and keys.clients again, as on SIGHUP", reload_keys},
    {"stop", "", "", "drain and end", commands_stop},
};
const size_t dmn_n_commands = sizeof dmn_commands / sizeof *dmn_commands;

const struct dmn_command *dmn_command_find(const char *name)
{
    for (size_t i = 0; i < dmn_n_commands; i++)
        if (strcmp(dmn_commands[i].name, name) == 0)
            return &dmn_commands[i];
    return NULL;
}

static size_t no_command(struct dmn_answer to)
{
    char text[512] = "unknown command; there are";
    for (size_t i = 0, n = strlen(text); i < dmn_n_commands && n < sizeof text; i++)
        n += (size_t)snprintf(text + n, sizeof text - n, "%s %s", i > 0 ? "," : "",
                              dmn_commands[i].name);
    return dmn_answer_error(to, text);
}

static bool commands_word_in(const char *word, const char *list)
{
    size_t n = strlen(word);
    for (const char *p = list; n > 0 && (p = strstr(p, word)) != NULL; p++)
        if ((p == list || p[-1] == ' ') && (p[n] == '\0' || p[n] == ' '))
            return strchr(word, ' ') == NULL;
    return false;
}

/* A key that neither this command nor every command has; NULL: there is none. */
static const char *foreign_key(const struct dmn_command *k, const cJSON *request)
{
    const cJSON *item;
    cJSON_ArrayForEach(item,
                       request) if (!commands_word_in(item->string, "cmd version") &&
                                    !commands_word_in(item->string, k->keys)) return item->string;
    return NULL;
}

static size_t commands_command(OPS)
{
    const char *cmd = commands_text_of(request, "cmd");
    const cJSON *version = cJSON_GetObjectItemCaseSensitive(request, "version");
    if (cmd == NULL)
        return dmn_answer_error(to, "the request has no text \"cmd\"");
    if (version != NULL &&
        (!cJSON_IsNumber(version) || version->valuedouble != DMN_CONTROL_VERSION))
        return dmn_answer_error(to, "version should be 1: this daemon speaks no other");
    const struct dmn_command *k = dmn_command_find(cmd);
    if (k == NULL)
        return no_command(to);
    const char *foreign = foreign_key(k, request);
    if (foreign != NULL) {
        char text[300];
        snprintf(text, sizeof text, "%s: unknown key \"%.64s\"; it may have %s", k->name, foreign,
                 k->keys[0] != '\0' ? k->keys : "none");
        return dmn_answer_error(to, text);
    }
    size_t n = k->answer(ops, request, to);
    return n > 0 ? n : dmn_answer_error(to, "the answer does not fit into a reply");
}

size_t dmn_control_handle(const struct dmn_control_ops *ops, const void *request, size_t len,
                          char *reply, size_t size)
{
    static const char head[] =
        "{\"version\":1"; /* goes before the command's answer, whose { becomes a comma */
    struct dmn_answer to = {reply + sizeof head - 1, size - (sizeof head - 1)};
    cJSON *req = len > DMN_REQUEST_MAX ? NULL : cJSON_ParseWithLength(request, len);
    size_t n = len > DMN_REQUEST_MAX ? dmn_answer_error(to, "the request is longer than 4096 bytes")
               : cJSON_IsObject(req) ? commands_command(ops, req, to)
                                     : dmn_answer_error(to, "the request is not a JSON object");
    cJSON_Delete(req);
    memcpy(reply, head, sizeof head - 1);
    to.text[0] = ',';
    return n + sizeof head - 1;
}
