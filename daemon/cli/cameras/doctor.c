/* doctor.c - `pyrovox doctor`: causes of lost frames on this host, and the remedy for each. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/log.h"
#include "daemon/cli/cameras/camtest.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/config/config.h"
#include "daemon/doctor/doctor.h"
#include "daemon/doctor/host.h"

struct args {
    const char *config, *fix_script, *record;
    bool json, all, cameras;
    double sample_s, disk_mb;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"c|config", "FILE", AT(config), 0, 0,
     "the daemon's configuration: then the checks know how many cameras there are, where, how "
     "large and how fast"},
    {"cameras", NULL, AT(cameras), 0, 0,
     "open the cameras of --config for a moment, and see whether they clip their blacks"},
    {"a|all", NULL, AT(all), 0, 0, "show what is well, too"},
    {"json", NULL, AT(json), 0, 0, "print JSON"},
    {"fix-script", "FILE", AT(fix_script), 0, 0,
     "write all remedies as a shell script to read and run as root (- = standard output)"},
    {"sample", "SECONDS", AT(sample_s), 0, 3600,
     "read counters of lost packets twice, so far apart (1); what grows meanwhile is a failure"},
    {"record", "DIR", AT(record), 0, 0, "check room for raw recordings in this folder"},
    {"disk-test", "MB", AT(disk_mb), 1, 1e6, "and write so much there to see how fast it is"},
    {0}};

static const char doc[] =
    "Check this host for faults that lose frames, and print a remedy for each.\vExamples:\n"
    "  pyrovox doctor\n"
    "  sudo pyrovox doctor --config /etc/pyrovox/pyrovoxd.yaml\n"
    "  pyrovox doctor --config pyrovoxd.yaml --cameras\n"
    "  pyrovox doctor --sample 10    # which counters grow while the daemon runs?\n"
    "  pyrovox doctor --fix-script fix.sh && less fix.sh && sudo sh fix.sh\n"
    "  pyrovox doctor --json | jq '.findings[] | select(.verdict == \"fail\") | .id'\n"
    "  pyrovox doctor --record /data/takes --disk-test 500\n"
    "\n"
    "Checks socket buffers, network cards and their counters, routing, firewall, interrupts, "
    "processors, memory, limits and rights, USB, PTP and clocks, disks. The most important fault "
    "comes first, with the command or the line of a file that corrects it. Nothing is changed.\n"
    "\n"
    "Exits with 0 when all is well, 1 with warnings or checks that cannot be made, 2 with "
    "failures, 3 when the check itself failed.";

static error_t doctor_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_ARG: argp_error(st, "'%s': takes options only", arg); return 0;
    case ARGP_KEY_END:
        if (a->disk_mb > 0 && a->record == NULL)
            argp_error(st, "--disk-test needs --record DIR");
        if (a->cameras && a->config == NULL)
            argp_error(st, "--cameras needs --config FILE");
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static pvx_err get_load(const struct args *a, struct doc_load *l, struct pvx_diag *d)
{
    doc_load_assumed(l);
    if (a->config != NULL) {
        struct dmn_config *c = pvx_calloc(1, sizeof *c);
        PVX_NEED(c);
        pvx_err e = dmn_config_load(a->config, c, d);
        PVX_THEN(e, doc_load_config(c, l, d));
        free(c);
        PVX_TRY(e);
    }
    if (a->record != NULL)
        snprintf(l->record, sizeof l->record, "%s", a->record);
    return PVX_OK;
}

/* Open the cameras and look at one picture of each.  Why they cannot be opened, a check says. */
static void doctor_look(const struct args *a, struct doc_load *l)
{
    struct camtest_options o = {.config = a->config, .seconds = 0.1};
    struct camtest *t = NULL;
    struct pvx_diag d = {""};
    pvx_log_set_level(PVX_LOG_ERROR);
    cli_catch_stop();
    pvx_err e = camtest_new(&o, &t, &d);
    PVX_THEN(e, camtest_run(t, &d));
    PVX_THEN(e, camtest_look(t, &d));
    if (e != PVX_OK)
        cli_error(&d, e);
    for (uint32_t i = 0; i < l->n; i++) {
        struct doc_load_camera *k = &l->camera[i];
        k->looked = true;
        k->pictured = e == PVX_OK && t->camera[i].last != NULL;
        k->cut = k->pictured ? t->camera[i].cut : 0;
        k->pedestal = k->pictured ? t->camera[i].pedestal : 0;
    }
    camtest_free(&t);
}

static pvx_err doctor_write_script(const char *path, const struct doctor *doctor,
                                   struct pvx_diag *d)
{
    if (strcmp(path, "-") == 0) {
        doc_script(stdout, doctor);
        return PVX_OK;
    }
    char *text = NULL;
    size_t len = 0;
    FILE *f = open_memstream(&text, &len);
    PVX_NEED(f);
    doc_script(f, doctor);
    pvx_err e = fclose(f) == 0 ? pvx_file_write(path, text, len, d) : PVX_ENOMEM;
    free(text);
    if (e == PVX_OK)
        fprintf(stderr, "remedies written to %s: read it, then run it as root\n", path);
    return e;
}

static int doctor_run(int argc, char **argv)
{
    struct args a = {.sample_s = 1};
    const struct argp argp = {.parser = doctor_parse, .doc = doc};
    argp_err_exit_status = 3; /* 1 and 2 are verdicts about the host */
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct doctor *doctor = pvx_calloc(1, sizeof *doctor);
    struct doc_host host;
    struct pvx_diag d = {""};
    pvx_err e = doctor == NULL ? PVX_ENOMEM : get_load(&a, &doctor->load, &d);
    int code = 3;
    if (e == PVX_OK) {
        if (a.cameras)
            doctor_look(&a, &doctor->load);
        doc_host_init(&host);
        host.sample_s = a.sample_s;
        host.disk_write = a.disk_mb * 1e6;
        doctor->host = &host;
        doc_run(doctor);
        const struct doc_style style = {.colour =
                                            isatty(STDOUT_FILENO) && getenv("NO_COLOR") == NULL,
                                        .all = a.all,
                                        .width = cli_columns(120)};
        bool script_only = a.fix_script != NULL && strcmp(a.fix_script, "-") == 0;
        if (a.json)
            e = doc_print_json(stdout, doctor, &d);
        else if (!script_only)
            doc_print(stdout, doctor, &style);
        if (e == PVX_OK && a.fix_script != NULL)
            e = doctor_write_script(a.fix_script, doctor, &d);
        code = doc_exit_status(&doctor->report);
    }
    free(doctor);
    if (e != PVX_OK)
        cli_error(&d, e);
    return e != PVX_OK ? 3 : code;
}

const struct cli_command cmd_doctor = {"doctor", "what on this host loses frames, and the remedies",
                                       doctor_run};
