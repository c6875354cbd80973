/* ctl.c - `pyrovox ctl`: send a command of the daemon's own table to a running daemon. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/ask.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/verdict.h"
#include "daemon/config/endpoints.h"
#include "daemon/control/commands.h"

#define WORDS_MAX 4
#define CHECK_MS  5000

struct args {
    const char *endpoint, *key;
    bool json;
    int n;
    const char *word[WORDS_MAX + 2]; /* the command first, NULL last */
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"control", "ENDPOINT", AT(endpoint), 0, 0,
     "the daemon's control.endpoint, default the user's own daemon, else the system's"},
    {"k|key", "FILE", AT(key), 0, 0,
     "your .key file of `pyrovox keygen`, for a daemon that asks for one"},
    {"json", NULL, AT(json), 0, 0, "print the answer as it came"},
    {0}};

static const char doc[] = "Tell a running pyrovoxd something.\v";

/* Text of --help after the options: the table of commands, and examples. */
static char *ctl_help(int key, const char *text, void *input)
{
    char *out = NULL;
    size_t len = 0;
    (void)input;
    if (key != ARGP_KEY_HELP_POST_DOC)
        return (char *)text;
    FILE *f = open_memstream(&out, &len);
    if (f == NULL)
        return NULL;
    fputs("Commands:\n", f);
    for (size_t i = 0; i < dmn_n_commands; i++)
        fprintf(f, "  %s%s%s: %s\n", dmn_commands[i].name, dmn_commands[i].usage[0] ? " " : "",
                dmn_commands[i].usage, dmn_commands[i].help);
    fputs("\nExits with 1 if no daemon answers, if it refuses, or if a check is bad.\n\nExamples:\n"
          "  pyrovox ctl get solver.lambda\n"
          "  pyrovox ctl set publish.compress lz4\n"
          "  pyrovox ctl record start flame7.h5\n"
          "  pyrovox ctl record start volumes\n"
          "  pyrovox ctl snapshot strange\n"
          "  pyrovox ctl check\n"
          "  pyrovox ctl --control tcp://lab:5556 --key me.key stop",
          f);
    return fclose(f) == 0 ? out : NULL;
}

static error_t ctl_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_ARG:
        if (a->n > WORDS_MAX)
            argp_error(st, "'%s': too many words", arg);
        a->word[a->n++] = arg;
        /* the value of set may begin with a minus */
        if (a->n == 2 && strcmp(a->word[0], "set") == 0 && st->next < st->argc)
            a->word[a->n++] = st->argv[st->next++];
        return 0;
    case ARGP_KEY_END:
        if (a->n == 0)
            argp_error(st, "which command? --help lists them");
        else if (dmn_command_find(a->word[0]) == NULL)
            argp_error(st, "no command '%s'; --help lists them", a->word[0]);
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static void print_options(const cJSON *list)
{
    const cJSON *o;
    cJSON_ArrayForEach(o, list)
    {
        bool live = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(o, "live"));
        printf("%-26s %s%s%s  (default %s%s)\n", ask_text(o, "key", NULL),
               ask_text(o, "value", NULL), ask_text(o, "unit", NULL)[0] != '\0' ? " " : "",
               ask_text(o, "unit", NULL), ask_text(o, "default", NULL),
               live ? "" : "; needs a restart");
    }
}

/* Print a reply: options as a table, the status as JSON, others as their members without ok and version. */
static void ctl_print(const cJSON *reply, const char *command)
{
    const cJSON *m, *list = cJSON_GetObjectItemCaseSensitive(reply, "options");
    if (list != NULL) {
        print_options(list);
    } else if (strcmp(command, "status") == 0) {
        char *text = cJSON_Print(reply);
        puts(text != NULL ? text : "");
        free(text);
    } else {
        const char *space = "ok: ";
        cJSON_ArrayForEach(m, reply)
        {
            if (strcmp(m->string, "ok") == 0 || strcmp(m->string, "version") == 0)
                continue;
            if (cJSON_IsNumber(m))
                printf("%s%s %.15g", space, m->string, m->valuedouble);
            else if (cJSON_IsString(m))
                printf("%s%s %s", space, m->string, m->valuestring);
            space = ", ";
        }
        puts(space[0] == 'o' ? "ok" : "");
    }
}

/* Wait for the verdict of a check that was begun.  Nothing is waited for without end: the daemon gives up when no sets
 * come. */
static pvx_err ctl_await(const struct args *a, cJSON **reply, struct pvx_diag *d)
{
    char request[80];
    snprintf(request, sizeof request, "{\"cmd\":\"check\",\"request\":%.0f}",
             ask_num(*reply, "request", NULL));
    while (strcmp(ask_text(*reply, "state", NULL), "taking") == 0) {
        pvx_sleep_until_mono(pvx_now_mono() + PVX_NS_PER_S / 10);
        cJSON_Delete(*reply);
        PVX_TRY(ask_request(a->endpoint, a->key, request, CHECK_MS, reply, d));
    }
    if (strcmp(ask_text(*reply, "state", NULL), "failed") != 0)
        return PVX_OK;
    pvx_fail(d, PVX_EINVAL, "%s", ask_text(*reply, "why", NULL));
    cJSON_Delete(*reply);
    *reply = NULL;
    return PVX_EINVAL;
}

static int ctl_run(int argc, char **argv)
{
    struct args a = {0};
    const struct argp argp = {
        .parser = ctl_parse, .args_doc = "COMMAND [WORDS]", .doc = doc, .help_filter = ctl_help};
    cli_parse(rows, &argp, ARGP_IN_ORDER, argc, argv, &a);
    if (a.endpoint == NULL)
        a.endpoint = dmn_client_endpoint(DMN_CONTROL);
    struct pvx_diag d = {""};
    cJSON *reply;
    pvx_err e = ask_words(a.endpoint, a.key, a.word, 0, &reply, &d);
    const bool check = strcmp(a.word[0], "check") == 0;
    if (e == PVX_OK && check)
        e = ctl_await(&a, &reply, &d);
    if (e != PVX_OK) {
        int code = cli_error(&d, e);
        return e == PVX_ERANGE ? 2 : code;
    }
    if (a.json) {
        char *text = cJSON_Print(reply);
        puts(text != NULL ? text : "");
        free(text);
    } else if (check) {
        struct rec_plausible_verdict v;
        char line[REC_PLAUSIBLE_LINE];
        belong_verdict(reply, &v);
        rec_plausible_line(&v, line);
        puts(line);
    } else {
        ctl_print(reply, a.word[0]);
    }
    const bool bad = check && !cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(reply, "good"));
    cJSON_Delete(reply);
    return bad;
}

const struct cli_command cmd_ctl = {"ctl", "tell a running daemon something", ctl_run};
