/* check.c - `pyrovox calibrate check`: does a flame agree with the rig? */
#include <stdio.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/options.h"
#include "daemon/cli/calibrate/report.h"
#include "daemon/cli/calibrate/check_say.h"
#include "daemon/cli/common/cli.h"
#include "recon/check/plausible.h"

struct args {
    struct flame_sets_args sets;
    const char *report[CALIBRATE_REPORTS];
    size_t n_reports;
};

enum { OPT_REPORT = 0x100 };

static const struct argp_option options[] = {
    {"report", OPT_REPORT, "FILE", 0,
     "a page to look at (FILE.html: each camera's picture, the outline of the flame by the others, "
     "displacements as arrows) or all figures (FILE.json); may be given twice",
     0},
    {0}};

static const char doc[] =
    "Compare each camera with the volume that the other cameras make of a flame.\vExamples:\n"
    "  pyrovox calibrate check --rig rig.yaml --frames take.h5 --black 0.02 \\\n"
    "          --report check.html\n"
    "\n"
    "Names the camera that is wrong and how: dark, flooded, moved (by how many pixels, which way), "
    "mirrored, late, blurred, of another gain. Needs at least four cameras and a flame that moves. "
    "More frame sets make it surer.\n"
    "displaced: from where the others see its flame to where the camera has it. turned: clockwise. "
    "size: larger is nearer. agrees: correlation, 1 is perfect. residual: share of what the others "
    "make of its picture.\n"
    "Exit code 0: all agree. 1: one is wrong, or nothing can be judged.\n"
    "A camera that moved is corrected by the flame (`pyrovox calibrate refine`) or by a board "
    "(`pyrovox calibrate live --keep rig.yaml --recover CAMERA`).";

static error_t check_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &a->sets; return 0;
    case OPT_REPORT:
        if (a->n_reports == CALIBRATE_REPORTS)
            argp_error(st, "--report: at most %d, one .html and one .json", CALIBRATE_REPORTS);
        else
            a->report[a->n_reports++] = arg;
        return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': this step takes options only", arg); return 0;
    case ARGP_KEY_END:
        if (a->sets.frames == NULL)
            argp_error(st, "which flame? --frames DIR or TAKE.h5");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static pvx_err check_run(const struct args *a, struct flame_sets *s, bool *wrong,
                         struct pvx_diag *d)
{
    static struct rec_check_verdict verdict; /* large */
    struct rec_plausible_verdict belong;
    struct check_result r = {a->sets.rig, a->sets.frames, s, NULL, &verdict, &belong};
    for (size_t i = 0; i < a->n_reports; i++)
        PVX_TRY(calibrate_report_possible(a->report[i], true, d));
    PVX_TRY(flame_sets_load(s, &a->sets, d));
    PVX_TRY(rec_check_new(&s->rig, &s->params, s->pool, &r.check, d));
    struct rec_check_source from = flame_sets_source(s, "check");
    pvx_err e = flame_sets_belong(s, rec_check_unseen(r.check), &belong);
    PVX_THEN(e, rec_check_run(r.check, &s->rig, &from, &verdict, d));
    if (e == PVX_OK) {
        check_print(&r);
        fflush(stdout);
        *wrong = verdict.outcome != REC_CHECK_AGREES || check_explained(&r);
    }
    for (size_t i = 0; i < a->n_reports && e == PVX_OK; i++)
        e = calibrate_write_report(a->report[i], check_json, check_html, &r, d);
    rec_check_free(&r.check);
    return e;
}

int calibrate_check(int argc, char **argv)
{
    struct args a = {.sets = FLAME_SETS_INIT};
    const struct argp_child children[] = {{flame_sets_argp(), 0, NULL, 0}, {0}};
    const struct argp argp = {
        .options = options, .parser = check_parse_opt, .doc = doc, .children = children};
    if (argp_parse(&argp, argc, argv, 0, NULL, &a) != 0)
        return 2;
    struct pvx_diag d = {""};
    struct flame_sets s = {0};
    bool wrong = false;
    cli_catch_stop();
    pvx_err e = check_run(&a, &s, &wrong, &d);
    flame_sets_fini(&s);
    return e == PVX_OK ? wrong : cli_end(&d, e, true);
}
