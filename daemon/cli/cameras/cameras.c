/* cameras.c - `pyrovox cameras`: which cameras can be found, as lines for the configuration; and
 * `pyrovox cameras test`. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/rig/backends.h"
#include "daemon/cli/cameras/list.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/control/json.h"
#include "daemon/doctor/parse.h"
#include "daemon/doctor/wrap.h"

struct args {
    const char *scheme;
    bool json, formats;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"l|formats", NULL, AT(formats), 0, 0, "every format, size and rate, one a line"},
    {"json", NULL, AT(json), 0, 0, "print JSON"},
    {0}};

static const char doc[] =
    "List the cameras that can be found, or those of one backend (aravis, ...).\vExamples:\n"
    "  pyrovox cameras\n"
    "  pyrovox cameras -l v4l2\n"
    "  pyrovox cameras --json | jq -r '.cameras[].uri'\n"
    "  pyrovox cameras test --seconds 10 aravis:192.168.1.21 aravis:192.168.1.22\n"
    "\n"
    "Copy each line under \"cameras:\" of pyrovoxd.yaml. The name on the left must be one of the "
    "rig's. Below it are the formats, each with the largest size. Nothing is changed, and cameras "
    "in use are listed too. A backend that fails does not hide the others. A backend without "
    "cameras prints a possible reason.\n"
    "\n"
    "`pyrovox cameras test` grabs from cameras and judges them (see its own --help).\n"
    "\n"
    "Exits with 0 when a camera was found, else 1.";

static error_t cameras_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_ARG:
        if (a->scheme != NULL)
            argp_error(st, "'%s': one backend at a time, or none for all", arg);
        a->scheme = arg;
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static void print_formats(const char *formats, bool all, int width)
{
    char text[2048];
    if (formats == NULL || formats[0] == '\0')
        return;
    if (!all) {
        cameras_formats(formats, text, sizeof text);
        printf("        ");
        dmn_wrap(stdout, text, 8, 8, width);
        return;
    }
    for (const char *p = formats; *p != '\0';) {
        int n = (int)strcspn(p, "\n");
        printf("        %.*s\n", n, p);
        p += n + (p[n] == '\n');
    }
}

static void paragraph(const char *text, int width)
{
    printf("    ");
    dmn_wrap(stdout, text, 4, 4, width);
}

static void print_list(const struct cameras_list *l, const struct args *a, int width)
{
    bool unlisted = false;
    for (size_t i = 0; i < l->n_backends; i++) {
        const struct cameras_backend *b = &l->backend[i];
        unlisted |= !b->lists;
        if (!b->lists)
            continue;
        printf("%s%s  %zu camera%s\n", i > 0 ? "\n" : "", b->ops->scheme, b->n,
               b->n == 1 ? "" : "s");
        for (size_t k = b->first; k < b->first + b->n; k++) {
            const struct cameras_item *c = &l->item[k];
            printf("  cam%zu: \"%s\"  # %s\n", k, c->uri, c->text);
            print_formats(c->formats, a->formats, width);
        }
        if (b->error.text[0] != '\0') {
            printf("    failed: ");
            dmn_wrap(stdout, b->error.text, 12, 12, width);
        }
        if (b->n == 0)
            paragraph(b->why, width);
    }
    for (size_t i = 0; i < l->n_backends; i++)
        if (!l->backend[i].lists) {
            printf("%s%s  ", unlisted && l->n_backends > 1 ? "\n" : "", l->backend[i].ops->scheme);
            unlisted = false;
            printf("cannot be listed\n");
            paragraph(l->backend[i].ops->help, width);
        }
}

static void json_formats(struct dmn_json *j, const char *formats)
{
    dmn_json_open(j, "formats", '[');
    char line[256];
    for (const char *p = formats; p != NULL && doc_line_next(&p, line, sizeof line);)
        if (line[0] != '\0')
            dmn_json_str(j, NULL, line);
    dmn_json_close(j, ']');
}

static void cameras_fill(struct dmn_json *j, const void *what)
{
    const struct cameras_list *l = what;
    dmn_json_open(j, NULL, '{');
    dmn_json_open(j, "cameras", '[');
    for (size_t i = 0; i < l->n_backends; i++)
        for (size_t k = l->backend[i].first; k < l->backend[i].first + l->backend[i].n; k++) {
            dmn_json_open(j, NULL, '{');
            dmn_json_str(j, "backend", l->backend[i].ops->scheme);
            dmn_json_str(j, "uri", l->item[k].uri);
            dmn_json_str(j, "text", l->item[k].text);
            json_formats(j, l->item[k].formats);
            dmn_json_close(j, '}');
        }
    dmn_json_close(j, ']');
    dmn_json_open(j, "backends", '[');
    for (size_t i = 0; i < l->n_backends; i++) {
        const struct cameras_backend *b = &l->backend[i];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "scheme", b->ops->scheme);
        dmn_json_bool(j, "lists", b->lists);
        dmn_json_int(j, "cameras", (long long)b->n);
        dmn_json_str(j, "error", b->error.text);
        dmn_json_str(j, "why", b->why);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

static int cameras_run(int argc, char **argv)
{
    if (argc > 1 && strcmp(argv[1], "test") == 0) {
        static char name[80]; /* outlives this call: argp keeps pointers to argv[0] */
        snprintf(name, sizeof name, "%s test", argv[0]);
        argv[1] = name;
        return cmd_cameras_test(argc - 1, argv + 1);
    }
    struct args a = {0};
    const struct argp argp = {.parser = cameras_parse_opt,
                              .args_doc = "[BACKEND]\ntest [OPTION...] [SOURCE...]",
                              .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct cameras_list *l = pvx_calloc(1, sizeof *l);
    if (l == NULL)
        return cli_error(NULL, PVX_ENOMEM);
    cameras_find(a.scheme, l);
    int code = l->n > 0 ? 0 : 1;
    if (l->n_backends == 0) {
        fprintf(stderr, "pyrovox cameras: no backend '%s'; there are:\n", a.scheme);
        for (const struct cap_source_ops *const *b = cap_backends(); *b != NULL; b++)
            fprintf(stderr, "  %-10s %s\n", (*b)->scheme, (*b)->help);
        code = 2;
    } else if (a.json) {
        struct pvx_diag d = {""};
        pvx_err e = dmn_json_print(stdout, cameras_fill, l, &d);
        if (e != PVX_OK)
            code = cli_error(&d, e);
    } else {
        print_list(l, &a, cli_columns(120));
        if (l->n == 0)
            fprintf(stderr, "no camera found\n");
    }
    cameras_fini(l);
    free(l);
    return code;
}

const struct cli_command cmd_cameras = {"cameras", "list the cameras that can be found, test them",
                                        cameras_run};
