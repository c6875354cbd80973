/* test.c - `pyrovox cameras test`: measures what cameras deliver, and whether they expose together. */
#include <stdio.h>
#include <stdlib.h>

#include "base/log.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/cameras/list.h"
#include "daemon/cli/cameras/camtest.h"
#include "daemon/cli/common/cli.h"

enum { OPT_SIZE = 0x100 };

struct args {
    struct camtest_options o;
    const char *uri[REC_MAX_CAMERAS], *save;
    bool json;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"c|config", "FILE", AT(o.config), 0, 0,
     "the cameras of this pyrovoxd.yaml, set up as it says"},
    {"seconds", "N", AT(o.seconds), 0.1, 1e6, "watch for so long once all deliver (5)"},
    {"fps", "HZ", AT(o.fps), 0.01, 10000, "ask for this rate (the configuration's, or 20)"},
    {"pixel-format", "NAME", AT(o.pixel_format), 0, 0,
     "ask for this format, as Mono8 or BayerRG12p"},
    {"size", "WxH", CLI_KEY(OPT_SIZE), 0, 0,
     "ask for this size; without, as the camera is set (not with --config)"},
    {"trigger", "MODE", AT(o.trigger), 0, 0, "free-run, software, line or action"},
    {"save", "DIR", AT(save), 0, 0, "write one picture of each camera there"},
    {"json", NULL, AT(json), 0, 0, "print JSON"},
    {0}};

static const char doc[] =
    "Open cameras together, grab for some seconds and judge each.\vExamples:\n"
    "  pyrovox cameras test\n"
    "  pyrovox cameras test --config pyrovoxd.yaml --seconds 60 --save look\n"
    "  pyrovox cameras test --fps 30 \\\n"
    "          --pixel-format Mono8 aravis:192.168.1.21 aravis:192.168.1.22\n"
    "  pyrovox cameras test --trigger software sim: sim:drop=0.1\n"
    "\n"
    "Without SOURCE or --config it tests all cameras that are found. Columns: rate; good frames; "
    "lost frames (by cause below the table); jitter of the intervals between frames, standard "
    "deviation and worst, by the camera's own stamps and by arrival here; bytes per second; share "
    "of the link and temperature if the camera gives them.\n"
    "\n"
    "It says so if blacks are clipped, which adds light: for this, part of the picture must be "
    "dark.\n"
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
    case OPT_SIZE: cli_arg_size(st, "size", arg, 1, 16384, &a->o.width, &a->o.height); return 0;
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
    default: return cli_row(rows, key, arg, st, a);
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
    PVX_THEN(e, camtest_run(t, &d));
    PVX_THEN(e, camtest_look(t, &d));
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
    const struct argp argp = {.parser = cameras_parse, .args_doc = "[SOURCE...]", .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &a);
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
