/* top.c - `pyrovox top`: the live screen of a running daemon. */
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "base/yaml.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/running/screen.h"
#include "daemon/config/endpoints.h"

enum { OPT_TRUTH = 0x100 };

struct args {
    const char *endpoint, *key;
    struct follow_truth truth;
    double seconds;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"e|endpoint", "ENDPOINT", AT(endpoint), 0, 0,
     "where the volumes are published, default the user's own daemon, else the system's"},
    {"k|key", "FILE", AT(key), 0, 0,
     "your .key file of `pyrovox keygen`, for a daemon that asks for one"},
    {"truth", "SEED,PERIOD[,FPS]", CLI_KEY(OPT_TRUTH), 0, 0,
     "compare with the known flame of sim: cameras (sim.seed, sim.period_s) or of `pyrovox "
     "simcams` (--seed, --ring/--fps, --fps)"},
    {"seconds", "N", AT(seconds), 0, 1e9, "end by itself after N seconds (0: never, the default)"},
    {0}};

static const char doc[] =
    "Watch a running pyrovoxd: rate, latency, drops, cameras, hull, residual.\vExamples:\n"
    "  pyrovox top\n"
    "  pyrovox top --truth 1,2 --endpoint tcp://127.0.0.1:5555\n"
    "\n"
    "On a terminal the screen is redrawn in place. Elsewhere it is a line a second. Ctrl-C ends "
    "it, and the daemon goes on.";

static error_t top_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    char copy[96], *part[3] = {0}, *save = NULL;
    int64_t seed = 0;
    size_t n = 0;
    switch (key) {
    case OPT_TRUTH:
        snprintf(copy, sizeof copy, "%s", arg);
        for (char *p = strtok_r(copy, ",", &save); p != NULL; p = strtok_r(NULL, ",", &save))
            if (n++ < 3)
                part[n - 1] = p;
        if (n < 2 || n > 3 || strlen(arg) >= sizeof copy ||
            pvx_parse_int(part[0], 0, UINT32_MAX, &seed) != PVX_OK ||
            pvx_parse_double(part[1], 0.001, 1e6, &a->truth.period_s) != PVX_OK ||
            (n == 3 && pvx_parse_double(part[2], 0.001, 1e4, &a->truth.ring_fps) != PVX_OK))
            argp_error(st, "--truth %s: should be SEED,PERIOD or SEED,PERIOD,FPS", arg);
        a->truth.seed = (uint32_t)seed;
        a->truth.known = true;
        return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': takes options only", arg); return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static int top_run(int argc, char **argv)
{
    struct args a = {0};
    const struct argp argp = {.parser = top_parse, .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    if (a.endpoint == NULL)
        a.endpoint = dmn_client_endpoint(DMN_VOLUMES);
    cli_catch_stop();
    struct pvx_diag d = {0};
    struct follow f;
    struct screen s;
    pvx_err e = follow_init(&f, a.endpoint, a.key, &a.truth, &d);
    if (e != PVX_OK) {
        follow_fini(&f);
        return cli_error(&d, e);
    }
    char title[400];
    snprintf(title, sizeof title, "pyrovox top   %s", a.endpoint);
    fprintf(stderr, "waiting for volumes on %s\n", a.endpoint);
    int64_t t0 = pvx_now_mono();
    screen_open(&s);
    bool first = true;
    while (!cli_stop && e == PVX_OK &&
           (a.seconds == 0 || (double)(pvx_now_mono() - t0) * 1e-9 < a.seconds)) {
        e = follow_poll(&f, 50 * PVX_NS_PER_MS, &d);
        if (first && f.volumes > 0) { /* the rate does not include the wait for the first */
            follow_mark(&f);
            first = false;
        }
        screen_draw(&s, &f, title, "Ctrl-C ends this view");
    }
    screen_close(&s);
    follow_fini(&f);
    return e == PVX_OK ? 0 : cli_error(&d, e);
}

const struct cli_command cmd_top = {"top", "live screen of a running daemon", top_run};
