/* report.c - `pyrovox report`: a recording of volumes on one page that can be attached to a paper. */
#include "daemon/cli/advise/report.h"

#include <argp.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/report/pdf.h"

static const char doc[] =
    "Describe a recording of volumes on one page, to read and to attach to a paper.\v"
    "Examples:\n"
    "  pyrovox report flame.h5 --rig rig.yaml --out page\n"
    "  pyrovox report flame.h5 --rig rig.yaml --frames take.h5 --out page\n"
    "\n"
    "DIR/report.html, and report.pdf if weasyprint is installed: setup, calibration, rates and "
    "losses, "
    "one volume in three slices, height, volume and light over time, all with their error bars if "
    "the "
    "recording has them, versions and every option. With --frames the pictures add left-out views, "
    "and "
    "what `pyrovox advise` finds, and with --temperature those of soot. DIR/sets.csv has the "
    "figures of each set.\n"
    "\n"
    "Exit: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C.";

enum { KEY_OUT = 256, KEY_SET, KEY_TEMPERATURE, KEY_FORCE };
static const struct argp_option options[] = {
    {"out", KEY_OUT, "DIR", 0, "write the page there", 0},
    {"temperature", KEY_TEMPERATURE, "T.h5", 0, "add the temperatures of `pyrovox temperature`", 0},
    {"set", KEY_SET, "N", 0, "show this set in slices (default: the one with the most light)", 0},
    {"force", KEY_FORCE, NULL, 0, "write over a report that is there", 0},
    {0}};

static error_t report_parse(int key, char *arg, struct argp_state *st)
{
    struct report *r = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &r->a; return 0;
    case KEY_OUT: r->out = arg; return 0;
    case KEY_SET: cli_arg_int(st, "set", arg, 0, INT64_MAX, &r->set); return 0;
    case KEY_TEMPERATURE: r->temperature = arg; return 0;
    case KEY_FORCE: r->force = true; return 0;
    case ARGP_KEY_ARG: cli_arg_one(st, "one recording of volumes", arg, &r->in); return 0;
    case ARGP_KEY_END:
        if (r->in == NULL || r->out == NULL)
            argp_error(st, "needs a recording and --out: pyrovox report flame.h5 --rig rig.yaml "
                           "--out page");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static void report_grid(const struct pvp_grid *from, struct rec_grid *g)
{
    for (int a = 0; a < 3; a++) {
        g->n[a] = (int32_t)from->n[a];
        g->min[a] = from->min[a];
        g->max[a] = from->max[a];
    }
    g->basis = from->basis == 1 ? REC_TRILINEAR : REC_BOX;
}

/* The hash of the rig that the recording keeps as text, on its grid; 0: it keeps none that can be read. */
static uint64_t report_kept(const struct vol_head *h)
{
    struct rec_rig was;
    if (h->rig == NULL || h->rig[0] == '\0' ||
        rec_rig_parse(h->rig, strlen(h->rig), "its rig", &was, NULL) != PVX_OK)
        return 0;
    report_grid(&h->start.grid, &was.grid);
    uint64_t hash = rec_rig_hash(&was);
    rec_rig_fini(&was);
    return hash;
}

/* The rig must be the one that the volumes were made with; its grid may be another. */
static pvx_err report_rig(struct report *r, struct pvx_diag *d)
{
    const struct pvp_start *s = &r->head->start;
    const uint64_t hash = s->rig_hash != 0 ? s->rig_hash : report_kept(r->head);
    PVX_TRY(rec_rig_load(r->a.rig, &r->rig, d));
    report_grid(&s->grid, &r->rig.grid);
    if (r->a.cameras != NULL)
        PVX_TRY(rec_rig_select(&r->rig, r->a.cameras, d));
    if (hash != 0 && rec_rig_hash(&r->rig) != hash)
        return pvx_fail(d, PVX_ESTALE,
                        "%s: was made with another rig than %s: a camera, its pose or its lens "
                        "differs; give the rig.yaml that made it, and --cameras if it used some",
                        r->in, r->a.rig);
    if (r->rig.n_cameras < 2)
        return pvx_fail(d, PVX_EINVAL, "%s: one camera made it, so it has no depth to report",
                        r->in);
    return PVX_OK;
}

static pvx_err report_choose(struct report *r, struct pvx_diag *d)
{
    const struct course *c = &r->course;
    for (size_t i = 0; i < c->n; i++) {
        if (r->set >= 0 && c->row[i].v.set == (uint64_t)r->set) {
            r->shown = i;
            return PVX_OK;
        }
        if (r->set < 0 &&
            c->row[i].figure[COURSE_LIGHT].v > c->row[r->shown].figure[COURSE_LIGHT].v)
            r->shown = i;
    }
    return r->set < 0 ? PVX_OK
                      : pvx_fail(d, PVX_ENOENT, "--set %lld: %s has no volume of it",
                                 (long long)r->set, r->in);
}

/* Nothing is written over, and the folder is made. */
static pvx_err report_place(const struct report *r, struct pvx_diag *d)
{
    static const char *const names[] = {"report.html", "report.pdf",  "sets.csv",
                                        "slice-x.png", "slice-y.png", "slice-z.png",
                                        "bar-x.png",   "bar-y.png",   "bar-z.png"};
    char path[4300];
    PVX_TRY(pvx_mkdirs(r->out, d));
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        snprintf(path, sizeof path, "%s/%s", r->out, names[k]);
        PVX_TRY(cli_may_write(path, r->force, d));
    }
    return PVX_OK;
}

/* The temperatures must be of the same sets. */
static pvx_err report_heat(struct report *r, struct pvx_diag *d)
{
    const struct course_how how = {
        .measure = {.channel = -1}, .to = INT64_MAX, .quiet = r->a.quiet};
    vol_thermal_reader *t;
    if (r->temperature == NULL)
        return PVX_OK;
    PVX_TRY(vol_thermal_read(r->temperature, &t, d));
    pvx_err e = course_read_thermal(t, r->temperature, &how, &r->heat, d);
    vol_thermal_read_close(&t);
    for (size_t i = 0; i < r->heat.n && e == PVX_OK; i++)
        for (size_t k = 0; k < r->course.n; k++)
            if (r->heat.row[i].v.set == r->course.row[k].v.set &&
                r->heat.row[i].v.t_exposure_ns == r->course.row[k].v.t_exposure_ns)
                return PVX_OK;
    return e != PVX_OK ? e
                       : pvx_fail(d, PVX_ESTALE,
                                  "%s: none of its sets is in %s: it is of another "
                                  "recording",
                                  r->temperature, r->in);
}

static pvx_err report_make(struct report *r, struct pvx_diag *d)
{
    const struct course_how how = {
        .measure = {.channel = -1, .level = (double)NAN}, .to = INT64_MAX, .quiet = r->a.quiet};
    char path[4300];
    PVX_TRY(vol_reader_open(r->in, &r->volumes, d));
    PVX_TRY(vol_reader_emission(r->volumes, r->in, d));
    r->head = vol_reader_head(r->volumes);
    if (vol_reader_count(r->volumes) == 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no volume in it", r->in);
    PVX_TRY(report_rig(r, d));
    PVX_TRY(report_place(r, d));
    PVX_TRY(course_read(r->volumes, r->in, &how, &r->course, d));
    PVX_TRY(report_choose(r, d));
    PVX_TRY(report_heat(r, d));
    PVX_TRY(report_views(r, d));
    PVX_TRY(report_slices(r, d));
    snprintf(path, sizeof path, "%s/sets.csv", r->out);
    PVX_TRY(course_csv(&r->course, path, d));
    PVX_TRY(report_page(r, d));
    return report_pdf(r->out);
}

static int report_run(int argc, char **argv)
{
    const struct argp_child children[] = {{flame_sets_argp(), 0, NULL, 1}, {0}};
    const struct argp argp = {.options = options,
                              .parser = report_parse,
                              .args_doc = "FILE",
                              .doc = doc,
                              .children = children};
    struct report r = {.a = FLAME_SETS_INIT, .set = -1, .argc = argc, .argv = argv};
    struct pvx_diag d = {""};
    r.a.sets = 20;
    argp_parse(&argp, argc, argv, 0, NULL, &r);
    cli_catch_stop();
    pvx_err e = report_make(&r, &d);
    if (e == PVX_OK && !r.a.quiet)
        fprintf(stderr, "%zu sets: %s/report.html\n", r.course.n, r.out);
    course_free(&r.course);
    course_free(&r.heat);
    vol_reader_close(&r.volumes);
    rec_rig_fini(&r.rig);
    free(r.advice);
    return cli_end(&d, e, false);
}

const struct cli_command cmd_report = {"report", "a recording of volumes on one page", report_run};
