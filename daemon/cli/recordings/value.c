/* value.c - `pyrovox value`: figures of a recording of volumes, each with its error bar. */
#include <argp.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/report/course.h"

struct value {
    const char *in, *csv, *plot;
    struct course_how how;
    bool force;
};

enum { KEY_BOX = 256, KEY_SPHERE, KEY_SLICE, KEY_CHANNEL };
#define AT(field) CLI_AT(struct value, field)

static const struct cli_row rows[] = {
    {"box", "X,Y,Z,X,Y,Z", CLI_KEY(KEY_BOX), 0, 0, "only voxels between two corners, in metres"},
    {"sphere", "X,Y,Z,R", CLI_KEY(KEY_SPHERE), 0, 0, "only voxels within R of a point, in metres"},
    {"slice", "AXIS=M", CLI_KEY(KEY_SLICE), 0, 0,
     "only the layer of voxels at a place of one axis: z=0.1"},
    {"channel", "mean|red|green|blue", CLI_KEY(KEY_CHANNEL), 0, 0,
     "of which channel (default: the mean of all)"},
    {"above", "X", AT(how.measure.level), 0, 1e30,
     "the level of `volume`, in 1/m (default: a tenth of the brightest voxel)"},
    {"from", "SET", AT(how.from), 0, (double)(INT64_MAX - 1023), "only this set and later ones"},
    {"to", "SET", AT(how.to), 0, (double)(INT64_MAX - 1023), "only this set and earlier ones"},
    {"csv", "FILE.csv", AT(csv), 0, 0, "write all figures and their bars to a table"},
    {"plot", "FILE.svg", AT(plot), 0, 0, "draw all figures over time"},
    {"force", NULL, AT(force), 0, 0, "write over files that are there"},
    {"q|quiet", NULL, AT(how.quiet), 0, 0, "no progress"},
    {0}};

static const char doc[] =
    "Print figures of a recording of volumes, set by set, each with its error bar.\v"
    "Examples:\n"
    "  pyrovox value flame.h5\n"
    "  pyrovox value flame.h5 --slice z=0.1 --csv slice.csv\n"
    "  pyrovox value flame.h5 --sphere 0,0,0.2,0.05 --channel red --plot core.svg\n"
    "\n"
    "mean is the mean emission of the region, light the sum times the volume of a voxel, height "
    "the "
    "z below which 98 % of the light lies, volume that of all voxels above a level, and most the "
    "brightest voxel. 12.3 \u00b1 0.8 has a bar of one standard deviation. It holds noise, what "
    "the "
    "cameras cannot see, and the uncertainty of the rig (recon/NUMERICS.md, 21).\n"
    "\n"
    "A recording has bars if `pyrovox reconstruct --error-bars` made it. Without them the figures "
    "stand alone.\n"
    "\n"
    "FILE may also be what `pyrovox temperature` wrote: mean and hottest kelvin, and soot. Each "
    "voxel that has a temperature counts alike. Means have a bar if the recording of volumes had "
    "bars of sums.\n"
    "\n"
    "FILE is an HDF5 file, or a folder of .npy, .vdb or .nvdb files. Exit: 0 done, 1 failed, 2 "
    "wrong "
    "usage, 130 stopped by Ctrl-C.";

/* n numbers, separated by commas. */
static void value_numbers(struct argp_state *st, const char *name, const char *text, int n,
                          double *out)
{
    const char *at = text;
    for (int i = 0; i < n; i++) {
        char *end;
        errno = 0;
        out[i] = strtod(at, &end);
        if (end == at || errno != 0 || !isfinite(out[i]) || *end != (i + 1 < n ? ',' : '\0'))
            argp_error(st, "--%s %s: should be %d numbers with commas between them, in metres",
                       name, text, n);
        at = end + 1;
    }
}

static void value_region(struct argp_state *st, struct value *v, enum vol_region_kind kind,
                         const char *text)
{
    struct vol_region *r = &v->how.measure.region;
    if (r->kind != VOL_ALL)
        argp_error(st, "one region: --box, --sphere or --slice");
    r->kind = kind;
    if (kind == VOL_BOX)
        value_numbers(st, "box", text, 6, r->at);
    if (kind == VOL_SPHERE)
        value_numbers(st, "sphere", text, 4, r->at);
    if (kind == VOL_SPHERE && !(r->at[3] > 0))
        argp_error(st, "--sphere %s: the radius, the last number, should be above 0", text);
    if (kind != VOL_SLICE)
        return;
    const char *axis = text[0] != '\0' && text[1] == '=' ? strchr("xyz", text[0]) : NULL;
    if (axis == NULL)
        argp_error(st, "--slice %s: should be an axis and a place in metres, as z=0.1", text);
    else
        r->at[0] = (double)(*axis - 'x');
    value_numbers(st, "slice", text + 2, 1, r->at + 1);
}

static error_t value_parse(int key, char *arg, struct argp_state *st)
{
    static const char *const channels[] = {"mean", "red", "green", "blue", NULL};
    struct value *v = st->input;
    switch (key) {
    case KEY_BOX: value_region(st, v, VOL_BOX, arg); return 0;
    case KEY_SPHERE: value_region(st, v, VOL_SPHERE, arg); return 0;
    case KEY_SLICE: value_region(st, v, VOL_SLICE, arg); return 0;
    case KEY_CHANNEL:
        v->how.measure.channel = cli_arg_choice(st, "channel", arg, channels) - 1;
        return 0;
    case ARGP_KEY_ARG: cli_arg_one(st, "one recording of volumes", arg, &v->in); return 0;
    case ARGP_KEY_END:
        if (v->in == NULL)
            argp_error(st, "which recording? pyrovox value flame.h5");
        if (v->how.from > v->how.to)
            argp_error(st, "--from %lld is after --to %lld", (long long)v->how.from,
                       (long long)v->how.to);
        return 0;
    default: return cli_row(rows, key, arg, st, v);
    }
}

/* What the bars are, or why there are none; once for all sets. */
static void value_say_bars(const struct value *v, const struct course *c)
{
    if (c->with_bars == 0)
        fprintf(
            stderr,
            "pyrovox: %s has no error bars: `pyrovox reconstruct --error-bars` makes a recording "
            "that has them\n",
            v->in);
    else if (c->with_modes == 0)
        fprintf(
            stderr,
            "pyrovox: %s has error bars of single voxels alone, as folders and the recordings of a "
            "running daemon have: sums, heights and volumes have none. `pyrovox reconstruct "
            "--error-bars --out FILE.h5` makes them\n",
            v->in);
    else if (c->with_bars < c->n)
        fprintf(stderr, "pyrovox: %s: %zu of %zu sets have no error bars\n", v->in,
                c->n - c->with_bars, c->n);
    for (unsigned b = 0; b < 32; b++)
        if ((c->doubt >> b & 1) != 0)
            fprintf(stderr, "pyrovox: %s: bars in doubt, they may be too small: %s\n", v->in,
                    pvp_doubt_sentence(b) != NULL ? pvp_doubt_sentence(b)
                                                  : "for a reason that this version does not know");
}

/* Which figures of temperatures have a bar. */
static void value_say_heat(const struct value *v, const struct course *c)
{
    if (c->with_modes == 0)
        fprintf(stderr,
                "pyrovox: the bar is that of the hottest voxel: means have none, since %s does not "
                "know how errors go together. `pyrovox temperature` on a recording of `pyrovox "
                "reconstruct --error-bars --out FILE.h5` makes a file that knows\n",
                v->in);
    else
        fprintf(stderr,
                "pyrovox: bars hold noise and calibration; the volume has none, since which "
                "voxels have a temperature is no measured figure\n");
}

static pvx_err value_thermal_options(const struct value *v, struct pvx_diag *d)
{
    return v->how.measure.channel < 0 && isnan(v->how.measure.level)
               ? PVX_OK
               : pvx_fail(d, PVX_EINVAL,
                          "%s: has temperatures: --channel and --above are for volumes", v->in);
}

/* *kelvin: they are temperatures. */
static pvx_err value_volumes(const struct value *v, struct course *c, bool *kelvin,
                             struct pvx_diag *d)
{
    vol_reader *r;
    PVX_TRY(vol_reader_open(v->in, &r, d));
    *kelvin = strcmp(vol_reader_head(r)->start.units, VOL_UNITS_KELVIN) == 0;
    if (vol_reader_cut(r))
        fprintf(stderr, "pyrovox: %s was cut off, or is being written: %llu volumes are whole\n",
                v->in, (unsigned long long)vol_reader_count(r));
    pvx_err e = *kelvin ? value_thermal_options(v, d) : vol_reader_emission(r, v->in, d);
    PVX_THEN(e, *kelvin ? course_read_kelvin(r, v->in, &v->how, c, d)
                        : course_read(r, v->in, &v->how, c, d));
    vol_reader_close(&r);
    return e;
}

static pvx_err value_temperatures(const struct value *v, struct course *c, struct pvx_diag *d)
{
    vol_thermal_reader *r;
    PVX_TRY(value_thermal_options(v, d));
    PVX_TRY(vol_thermal_read(v->in, &r, d));
    pvx_err e = course_read_thermal(r, v->in, &v->how, c, d);
    vol_thermal_read_close(&r);
    return e;
}

static pvx_err value_of(struct value *v, struct pvx_diag *d)
{
    struct course c = {.n = 0};
    bool thermal = vol_is_thermal(v->in);
    PVX_TRY(cli_may_write(v->csv, v->force, d));
    PVX_TRY(cli_may_write(v->plot, v->force, d));
    pvx_err e = thermal ? value_temperatures(v, &c, d) : value_volumes(v, &c, &thermal, d);
    if (e == PVX_OK) {
        course_print(stdout, &c);
        fflush(stdout);
    }
    if (e == PVX_OK && thermal)
        value_say_heat(v, &c);
    if (e == PVX_OK && !thermal) {
        fprintf(stderr, "pyrovox: volume is that above %.4g 1/m\n", c.how.measure.level);
        value_say_bars(v, &c);
    }
    if (v->csv != NULL)
        PVX_THEN(e, course_csv(&c, v->csv, d));
    if (v->plot != NULL)
        PVX_THEN(e, course_plot(&c, v->plot, d));
    course_free(&c);
    return e;
}

static int value_run(int argc, char **argv)
{
    const struct argp argp = {.parser = value_parse, .args_doc = "FILE", .doc = doc};
    struct value v = {.how = {.measure = {.channel = -1, .level = NAN}, .to = INT64_MAX}};
    struct pvx_diag d = {""};
    cli_parse(rows, &argp, 0, argc, argv, &v);
    cli_catch_stop();
    pvx_err e = value_of(&v, &d);
    return cli_end(&d, e, e == PVX_ECANCELED);
}

const struct cli_command cmd_value = {"value", "figures of a recording of volumes, with error bars",
                                      value_run};
