/* status.c - `pyrovox status`: print the status of a running daemon once. */
#include <stdio.h>
#include <stdlib.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/ask.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/running/status_cameras.h"
#include "daemon/cli/running/status_compute.h"
#include "daemon/cli/running/status_ring.h"
#include "daemon/config/endpoints.h"

struct args {
    const char *endpoint, *key;
    bool json, stop, exit_code;
    double timeout_s;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"e|endpoint", "ENDPOINT", AT(endpoint), 0, 0,
     "the daemon's control.endpoint, default the user's own daemon, else the system's"},
    {"k|key", "FILE", AT(key), 0, 0,
     "your .key file of `pyrovox keygen`, for a daemon that asks for one"},
    {"json", NULL, AT(json), 0, 0, "print the answer as it came"},
    {"stop", NULL, AT(stop), 0, 0, "ask the daemon to drain and end"},
    {"exit-code", NULL, AT(exit_code), 0, 0,
     "exit with 1 if the last line says bad, or if the daemon is still starting"},
    {"timeout", "SECONDS", AT(timeout_s), 0.01, 3600, "wait so long for an answer (2)"},
    {0}};

static const char doc[] =
    "Print the state of a running pyrovoxd: rate, latency, drops by cause, cameras and "
    "stages.\vExamples:\n"
    "  pyrovox status\n"
    "  pyrovox status --json | jq .latency_ms\n"
    "  pyrovox status --endpoint ipc:///run/pyrovox/control\n"
    "  pyrovox status --exit-code > status.txt || tail -n 1 status.txt\n"
    "\n"
    "For each camera it prints faults with their remedy, how it compares with the others by the "
    "flame, and how far apart the cameras expose. The last line says \"good: ...\", or \"fair: \" "
    "or "
    "\"bad: ...; next: ...\" with the first thing to do. Exits with 1 if no daemon answers.";

static error_t status_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_ARG: argp_error(st, "'%s': takes options only", arg); return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static void print_sets(const cJSON *s)
{
    printf("%s, up %.0f s\n", ask_text(s, "software", NULL), ask_num(s, "uptime_s", NULL));
    printf("sets      %.2f/s now; %.0f from the cameras, %.0f published, %.0f under way\n",
           ask_num(s, "sets_per_s", NULL), ask_num(s, "sets", "produced"),
           ask_num(s, "sets", "published"), ask_num(s, "sets", "inside"));
    if (cJSON_HasObjectItem(s, "keys"))
        printf("keys      %.0f may come in, %.0f connections were refused\n",
               ask_num(s, "keys", "listed"), ask_num(s, "keys", "refused"));
    printf("clients   %.0f subscribed\n", ask_num(s, "subscribers", NULL));
    if (cJSON_HasObjectItem(s, "temperature"))
        printf("kelvin    %.0f subscribed; %.0f sets sent, %.0f left out since an older one was "
               "still being made, %.0f without error bars\n",
               ask_num(s, "temperature", "subscribers"), ask_num(s, "temperature", "made"),
               ask_num(s, "temperature", "left_out"), ask_num(s, "temperature", "without_bars"));
    printf("latency   p50 %.1f ms, p99 %.1f ms, max %.1f ms over %.0f sets\n",
           ask_num(s, "latency_ms", "p50"), ask_num(s, "latency_ms", "p99"),
           ask_num(s, "latency_ms", "max"), ask_num(s, "latency_ms", "n"));
    printf("spread    p50 %.2f ms, p99 %.2f ms between the exposures of a set\n",
           ask_num(s, "spread_ms", "p50"), ask_num(s, "spread_ms", "p99"));
    printf("hull      %.0f voxels, %.0f rays, %.0f entries\n", ask_num(s, "last", "active_voxels"),
           ask_num(s, "last", "active_rays"), ask_num(s, "last", "entries"));
    printf(
        "solver    %s: %s after %.0f iterations, %.0f with the channels as one, relative residual "
        "%.4f\n",
        ask_text(s, "last", "solver"), ask_text(s, "last", "status"),
        ask_num(s, "last", "iterations"), ask_num(s, "last", "blended_iterations"),
        ask_num(s, "last", "rel_residual"));
}

static void print_compute(const cJSON *s)
{
    char text[STATUS_LINE];
    if (compute_line(s, text, sizeof text) > 0)
        printf("compute   %s\n", text);
}

/* Only of a daemon with model.error_bars. */
static void print_error_bars(const cJSON *s)
{
    const char *what = "error_bars";
    const cJSON *b = cJSON_GetObjectItemCaseSensitive(s, what), *k;
    const char *before = "; in doubt: ";
    if (b == NULL)
        return;
    bool sent = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(b, "sent"));
    printf("bars      %s, %.0f sets solved once more, mean %.1f ms",
           sent ? "of the last volume" : "none yet", ask_num(b, "solves", NULL),
           ask_num(b, "mean_ms", NULL));
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(b, "doubts"))
    {
        printf("%s%s", before, cJSON_IsString(k) ? k->valuestring : "");
        before = ", ";
    }
    before = "; left out: ";
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(b, "left_out"))
    {
        if (ask_num(k, "value", NULL) == 0)
            continue;
        printf("%s%.0f %s", before, ask_num(k, "value", NULL), ask_text(k, "name", NULL));
        before = ", ";
    }
    puts("");
}

static void print_record(const cJSON *s)
{
    if (ask_text(s, "record", "path")[0] == '\0')
        return;
    printf(
        "raw       %s: %s, %.1f s, %.0f sets, %.1f MB; %.0f sets, %.0f frames not recorded%s%s\n",
        ask_text(s, "record", "state"), ask_text(s, "record", "path"),
        ask_num(s, "record", "seconds"), ask_num(s, "record", "sets"),
        ask_num(s, "record", "bytes") * 1e-6, ask_num(s, "record", "sets_missed"),
        ask_num(s, "record", "frames_missed"),
        ask_text(s, "record", "error")[0] != '\0' ? "; " : "", ask_text(s, "record", "error"));
}

static void print_record_volumes(const cJSON *s)
{
    const char *what = "record_volumes", *error = ask_text(s, what, "error");
    if (ask_text(s, what, "path")[0] == '\0')
        return;
    bool running = cJSON_IsTrue(
        cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(s, what), "running"));
    printf("recorded  %s: %s, %.0f volumes, %.0f lost, ended unasked %.0f times%s%s\n",
           running ? "recording" : "ended", ask_text(s, what, "path"), ask_num(s, what, "written"),
           ask_num(s, what, "lost"), ask_num(s, what, "deaths"), error[0] != '\0' ? "; " : "",
           error);
}

static void print_ring(const cJSON *s)
{
    char text[STATUS_LINE];
    const cJSON *k;
    if (ring_line(s, text, sizeof text) == 0)
        return;
    printf("ring      %s\n", text);
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(s, "triggers"))
    {
        trigger_line(k, text, sizeof text);
        printf("trigger   %s\n", text);
    }
}

static void print_tables(const cJSON *s)
{
    const cJSON *k, *v;
    printf("\n%-16s %8s  %s\n", "dropped", "sets", "meaning");
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(s, "drops"))
        printf("%-16s %8.0f  %s\n", ask_text(k, "name", NULL), ask_num(k, "value", NULL),
               ask_text(k, "help", NULL));
    printf("\n%-16s %8s %9s %9s %9s %8s\n", "stage", "items", "mean ms", "p99 ms", "max ms",
           "waiting");
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(s, "stages"))
        printf("%-16s %8.0f %9.2f %9.2f %9.2f %8.0f\n", ask_text(k, "name", NULL),
               ask_num(k, "items", NULL), ask_num(k, "mean_ms", NULL), ask_num(k, "p99_ms", NULL),
               ask_num(k, "max_ms", NULL), ask_num(k, "queued", NULL));
    printf("\n%-16s %-8s %8s %10s  %s\n", "camera", "state", "fps", "drift ppm", "counts");
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(s, "cameras"))
    {
        printf("%-16s %-8s %8.2f %10.1f ", ask_text(k, "name", NULL), ask_text(k, "state", NULL),
               ask_num(k, "fps", NULL), ask_num(k, "drift_ppm", NULL));
        cJSON_ArrayForEach(v,
                           cJSON_GetObjectItemCaseSensitive(k, "counts")) if (v->valuedouble != 0)
            printf(" %s %.0f", v->string, v->valuedouble);
        printf("\n");
        if (ask_text(k, "error", NULL)[0] != '\0')
            printf("%-16s %s\n", "", ask_text(k, "error", NULL));
    }
}

static int status_run(int argc, char **argv)
{
    struct args a = {.timeout_s = 2};
    const struct argp argp = {.parser = status_parse, .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    if (a.endpoint == NULL)
        a.endpoint = dmn_client_endpoint(DMN_CONTROL);
    struct pvx_diag d = {0};
    char line[STATUS_LINE];
    bool good = false;
    cJSON *s;
    pvx_err e =
        ask(a.endpoint, a.key, a.stop ? "stop" : "status", (int)(a.timeout_s * 1e3), &s, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    bool starting = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(s, "starting"));
    if (!a.stop && !starting)
        good = verdict_line(s, line);
    if (a.json) {
        char *text = cJSON_Print(s);
        if (text == NULL)
            e = PVX_ENOMEM;
        else
            puts(text);
        free(text);
    } else if (a.stop) {
        puts("the daemon is stopping");
    } else if (starting) {
        printf("starting; system matrix %.0f %%\n", 100 * ask_num(s, "matrix_done", NULL));
    } else {
        print_sets(s);
        print_compute(s);
        print_error_bars(s);
        print_record(s);
        print_record_volumes(s);
        print_ring(s);
        print_tables(s);
        troubles_print(s);
        votes_print(s);
        selfcal_print(s);
        checks_print(s);
        skew_print(s);
        health_print(s);
        printf("\n%s\n", line);
    }
    cJSON_Delete(s);
    return e != PVX_OK ? cli_error(&d, e) : a.exit_code && !a.stop && !good;
}

const struct cli_command cmd_status = {"status", "what a running daemon says about itself",
                                       status_run};
