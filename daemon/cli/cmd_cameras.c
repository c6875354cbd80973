/* cmd_cameras.c - `pyrovox cameras`: which cameras can be found, as lines for the configuration. */
#include <argp.h>
#include <stdio.h>
#include <string.h>

#include "capture/source.h"
#include "cli/cli.h"

static const char doc[] =
    "List the cameras that can be found, or those of one backend (aravis, ...).\v"
    "Each line can be copied under \"cameras:\" of pyrovoxd.yaml; the name on the left must be one "
    "of the rig's.  Nothing is opened or changed: a camera in use is listed too.\n"
    "\n"
    "Example:\n"
    "  cam0: \"aravis:192.168.1.21\"  # Basler acA640, serial 21839, GigEVision\n";

static error_t parse_opt(int key, char *arg, struct argp_state *st)
{
    const char **scheme = st->input;
    if (key != ARGP_KEY_ARG)
        return ARGP_ERR_UNKNOWN;
    if (*scheme != NULL)
        argp_usage(st);
    *scheme = arg;
    return 0;
}

static void found(void *ctx, const struct cap_found *f)
{
    unsigned *n = ctx;
    printf("  cam%u: \"%s\"  # %s\n", (*n)++, f->uri, f->text);
}

static int run(int argc, char **argv)
{
    const char *scheme = NULL;
    const struct argp argp = {.parser = parse_opt, .args_doc = "[BACKEND]", .doc = doc};
    argp_err_exit_status = 2;
    if (argp_parse(&argp, argc, argv, 0, NULL, &scheme) != 0)
        return 2;
    unsigned n = 0;
    bool known = false;
    for (const struct cap_source_ops *const *b = cap_backends(); *b != NULL; b++) {
        if (scheme != NULL && strcmp((*b)->scheme, scheme) != 0)
            continue;
        known = true;
        struct pvx_diag d = {""};
        pvx_err e = (*b)->list != NULL ? (*b)->list(found, &n, &d) : PVX_OK;
        if (e != PVX_OK)
            return cli_error(&d, e);
    }
    if (!known) {
        fprintf(stderr, "pyrovox cameras: no backend '%s'; there are:\n", scheme);
        for (const struct cap_source_ops *const *b = cap_backends(); *b != NULL; b++)
            fprintf(stderr, "  %-10s %s\n", (*b)->scheme, (*b)->help);
        return 2;
    }
    if (n == 0)
        fprintf(stderr, "no camera found (GigE cameras answer only on a network that this host has "
                        "an address of; simulated ones: pyrovox simcams)\n");
    return n > 0 ? 0 : 1;
}

const struct cli_command cmd_cameras = {"cameras", "list the cameras that can be found", run};
