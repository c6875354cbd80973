/* test.c - `pyrovox cameras test`: measures what cameras deliver, and whether they expose together. */
#include <argp.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/log.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/cameras/list.h"
#include "daemon/cli/cameras/camtest.h"
#include "daemon/cli/common/cli.h"

enum { OPT_JSON = 0x100, OPT_SECONDS, OPT_FPS, OPT_FORMAT, OPT_SIZE, OPT_TRIGGER, OPT_SAVE };

struct args {
    struct camtest_options o;
    const char *uri[REC_MAX_CAMERAS], *save;
    bool json;
};

static const struct argp_option options[] = {
    {"config", 'c', "FILE", 0, "the cameras of this pyrovoxd.yaml, set up as it says", 0},
    {"seconds", OPT_SECONDS, "N", 0, "watch for so long once all deliver (5)", 0},
    {"fps", OPT_FPS, "HZ", 0, "ask for this rate (the configuration's, or 20)", 0},
    {"pixel-format", OPT_FORMAT, "NAME", 0, "ask for this format, as Mono8 or BayerRG12p", 0},
    {"size", OPT_SIZE, "WxH", 0,
     "ask for this size; without, as the camera is set (not with --config)", 0},
    {"trigger", OPT_TRIGGER, "MODE", 0, "free-run, software, line or action", 0},
    {"save", OPT_SAVE, "DIR", 0, "write one picture of each camera there", 0},
    {"json", OPT_JSON, NULL, 0, "print JSON", 0},
    {0}};

static const char doc[] =
    "Open cameras together, grab for some seconds and judge each.\vExamples:\n"
    "  pyrovox cameras test\n"
    "  pyrovox cameras test --config pyrovoxd.yaml --seconds 60 --save look\n"
    "  pyrovox cameras test --fps 30 --pixel-format Mono8 aravis:192.168.1.21 aravis:192.168.1.22\n"
    "  pyrovox cameras test --trigger software sim: sim:drop=0.1\n"
    "\n"
    "Without SOURCE or --config it tests all cameras that are found. Columns: rate; good frames; "
    "lost frames (by cause below the table); jitter of the intervals between frames, standard "
    "deviation and worst, by the camera's own stamps and by arrival here; bytes per second; share "
    "of the link and temperature if the camera gives them.\n"
    "\n"
    "For several cameras it also prints how far apart the exposures of a set lie. Clocks that are "
    "not synchronized are mapped to the host's clock, which is right to 1 ms in the first "
    "seconds.\n"
    "\n"
    "Ctrl-C ends it early, and it prints what was measured. Exits with 0 when all is well, 1 when "
    "not, 130 after Ctrl-C.";

static error_t cameras_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case 'c': a->o.config = arg; return 0;
    case OPT_JSON: a->json = true; return 0;
    case OPT_SECONDS: a->o.seconds = cli_arg_double(st, "seconds", arg, 0.1, 1e6); return 0;
    case OPT_FPS: a->o.fps = cli_arg_double(st, "fps", arg, 0.01, 10000); return 0;
    case OPT_FORMAT: a->o.pixel_format = arg; return 0;
    case OPT_SIZE: cli_arg_size(st, "size", arg, 1, 16384, &a->o.width, &a->o.height); return 0;
    case OPT_TRIGGER: a->o.trigger = arg; return 0;
    case OPT_SAVE: a->save = arg; return 0;
    case ARGP_KEY_ARG:
        if (a->o.n == REC_MAX_CAMERAS)
            argp_error(st, "more than %d cameras", REC_MAX_CAMERAS);
        a->uri[a->o.n++] = arg;
        return 0;
    case ARGP_KEY_END:
        if (a->o.config != NULL && a->o.n > 0)
            argp_error(st, "--config names the cameras already; leave '%s' out", a->uri[0]);
        if (a->o.config != NULL && a->o.width > 0)
            argp_error(st, "--size: the rig says how large the pictures are");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

/* Use all cameras that can be found. */
static bool find_all(struct args *a, struct cameras_list *l)
{
    cameras_find(NULL, l);
    for (size_t i = 0; i < l->n && a->o.n < REC_MAX_CAMERAS; i++)
        a->uri[a->o.n++] = l->item[i].uri;
    if (a->o.n == 0)
        fprintf(stderr, "pyrovox cameras test: no camera found (`pyrovox cameras` says why); name "
                        "one, as sim:\n");
    return a->o.n > 0;
}

static int test(const struct args *a)
{
    struct camtest *t = NULL;
    struct pvx_diag d = {""};
    pvx_err e = camtest_new(&a->o, &t, &d);
    if (e == PVX_OK)
        e = camtest_run(t, &d);
    if (e != PVX_OK) {
        camtest_free(&t);
        return cli_error(&d, e);
    }
    camtest_judge(t);
    if (a->json)
        e = camtest_print_json(stdout, t, &d);
    else
        camtest_print(stdout, t, cli_columns(120));
    bool bad = t->verdict != CAMTEST_OK;
    for (uint32_t i = 0; i < t->n; i++)
        bad |= t->camera[i].verdict != CAMTEST_OK;
    int code = t->interrupted ? 130 : bad ? 1 : 0;
    if (e == PVX_OK && a->save != NULL)
        e = camtest_save(t, a->save, &d);
    if (e != PVX_OK)
        code = cli_error(&d, e);
    camtest_free(&t);
    return code;
}

int cmd_cameras_test(int argc, char **argv)
{
    struct args a = {.o = {.seconds = 5}};
    const struct argp argp = {
        .options = options, .parser = cameras_parse, .args_doc = "[SOURCE...]", .doc = doc};
    argp_parse(&argp, argc, argv, 0, NULL, &a);
    a.o.uri = a.uri;
    struct cameras_list *l = calloc(1, sizeof *l);
    if (l == NULL)
        return cli_error(NULL, PVX_ENOMEM);
    pvx_log_set_level(PVX_LOG_ERROR); /* the report contains the warnings */
    cli_catch_stop();
    int code = 1;
    if (a.o.config != NULL || a.o.n > 0 || find_all(&a, l))
        code = test(&a);
    cameras_fini(l);
    free(l);
    return code;
}
