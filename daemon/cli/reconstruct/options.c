#include "daemon/cli/reconstruct/options.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cli/common/arg.h"
#include "daemon/volumes/parts.h"
#include "daemon/config/compute.h"
#include "daemon/config/config.h"
#include "daemon/volumes/volumes.h"
#include "recon/frame/bars.h"

enum {
    OPT_SOLVER = 0x100,
    OPT_ITER,
    OPT_STOP,
    OPT_SELFCAL,
    OPT_BARS,
    OPT_ABSORPTION,
    OPT_MEMORY,
    OPT_PLAN,
    OPT_FIT,
    OPT_ARRAY
};

#define AT(field) CLI_AT(struct reconstruct_options, field)
#define STOPS     "auto|lcurve|discrepancy|iterations"
#define SELFCAL   "off|gain|on"

static const struct cli_row rows[] = {
    {"frames", "DIR|TAKE.h5|CAMERA=FILE,...", AT(frames), 0, 0,
     "the recording: a take of raw frames, or a folder with "
     "DIR/<camera>/<number>.(npy|png|tif|jpg) or DIR/<camera>.(mp4|mkv|mov|avi|cine|mraw|tif), or "
     "a list that names a folder, film or stack for each camera"},
    {"out", "DIR|FILE.h5", AT(out), 0, 0,
     "write volumes to DIR/<6 digits>.npy with a .json beside each, or into one HDF5 file. Volumes "
     "that are there already are not overwritten"},
    {"save-report", "FILE", AT(report), 0, 0, "write the report of every frame as JSON"},
    {"grey", NULL, AT(grey), 0, 0, "solve one channel (colour images: the mean of the three)"},
    {"bayer", "auto|rays|demosaic", AT(bayer), 0, 0,
     "Bayer pixels at binning 1. rays: each pixel is a ray of its own colour. demosaic: missing "
     "colours are interpolated. auto (default): rays where the solver can"},
    {"matrix-cache", "FILE", AT(cache), 0, 0,
     "keep the system matrix in FILE (default: in the user's cache)"},
    {"memory", "GB", CLI_KEY(OPT_MEMORY), 0, 0,
     "memory to use (default: four fifths of what is free). If the whole system matrix needs more, "
     "only the part where the frame sets have flame is built. The volumes are the same, but "
     "nothing is cached. 0: always only that part, without a limit"},
    {"plan", "=HOURS", CLI_KEY(OPT_PLAN), 0, 0,
     "reconstruct nothing. Measure about a minute of the work and print the time, memory and disk "
     "that all of it takes; with HOURS also how many machines like this one finish in that time"},
    FRAMES_IN_ROWS(struct reconstruct_options),
    {.help = "Means of several sets:"},
    {"average", "all|PERIOD", AT(reading.means.average), 0, 0,
     "solve the mean of all sets, or one mean for each phase of a cycle. PERIOD is in sets (20, "
     "12.5), or a time or rate with its unit where the sets have times (12.5ms, 80Hz). The noise "
     "of "
     "N sets falls by the square root of N. Volumes are numbered by phase, from 0"},
    {"phase", "FILE.csv", AT(reading.means.phases), 0, 0,
     "the same with the phase of each set from a file: a first line frame,phase (0 to 1) or "
     "frame,degrees, then a line for each set. Sets that are not listed are left out"},
    {"phases", "N", AT(reading.means.n), 1, 10000,
     "means in a cycle (default: one for each set of a PERIOD, 16 with --phase)"},
    {.help = "Volume fitted to the flame:"},
    {"fit-volume", "=MARGIN", CLI_KEY(OPT_FIT), 0, 0,
     "reconstruct in the tightest box around the flame of the whole recording, plus MARGIN metres "
     "on every side (default: about 1/48 of the rig's box). The box comes from the silhouettes. "
     "Voxels keep the rig's size; --grid N puts N along the longest side instead, --grid auto the "
     "finest grid that the pictures support"},
    {"fit-frames", "N|all", AT(fit_frames), 1, 999999,
     "find the box from N frame sets, evenly spread (default 50)"},
    {"save-rig", "FILE", AT(save_rig), 0, 0,
     "write the rig with the fitted volume, for the daemon; without --out do only that"},
    {.help = "Solver:"},
    {"solver", "NAME", CLI_KEY(OPT_SOLVER), 0, 0, "one of"},
    {"compute", DMN_COMPUTE_WORDS, AT(compute), 0, 0,
     "where the sets are solved. cpu (default): on the processors. auto: on a graphics card "
     "(OpenCL), if it is faster with some of these sets. opencl: on the first graphics card, or on "
     "the device whose name contains NAME, as `pyrovox cpu` lists them. The volumes are the same "
     "except for rounding. Sets that the device cannot do are solved on the processors. Not with "
     "--error-bars, --temporal, --saturated at-least, --stop lcurve, or other solvers"},
    {"iterations", "N", CLI_KEY(OPT_ITER), 0, 0, "at most N iterations; without --stop exactly N"},
    {"stop", STOPS, CLI_KEY(OPT_STOP), 0, 0,
     "auto (default): pcg stops when an iteration gains next to nothing, the others when the "
     "residual is down to the noise. lcurve: at the corner of the L-curve. discrepancy: when the "
     "residual is down to the noise, which is measured beside the flame. iterations: after "
     "--iterations, not earlier"},
    {"deadline", "MS", AT(deadline_ms), 0.01, 1e9,
     "stop after MS milliseconds of solving and keep the best iterate so far"},
    {"start", "cold|warm", AT(warm), 0, 0,
     "cold (default): each frame by itself. warm: from the frame before, where that fits better "
     "than the solution of the coarser grids; the report says which start was used"},
    {"lambda", "X", AT(frame.solve.lambda), 0, 1e6,
     "weight of the smoothness term (default: from the pictures)"},
    {"temporal", NULL, AT(frame.temporal), 0, 0,
     "expect the volume of the frame before, moved along the motion of the flame, as far as the "
     "pictures agree with it. For noisy pictures (5 %) of a slow flame. Only pcg can do it"},
    {"selfcal", SELFCAL, CLI_KEY(OPT_SELFCAL), 0, 0,
     "on (default): correct gain and aim of the cameras in the solve, where the pictures show "
     "beyond chance that they are off; the report has both, with errors. gain: gain alone. Only "
     "pcg does it, with four cameras or more"},
    {"error-bars", "=K", CLI_KEY(OPT_BARS), 0, 0,
     "give each voxel one standard deviation, from at most K more solves of each set (4 to 64, "
     "default 16): "
     "noise, what the cameras cannot see, and the rig's uncertainty. An HDF5 file also keeps what "
     "`pyrovox value` needs for the bar of a sum. Takes up to 12 times as long. Only pcg can do "
     "it"},
    {.help = "Silhouettes and hull:"},
    FRAMES_IN_PHOTO_ROWS(struct reconstruct_options),
    {"background", "DIR", AT(background), 0, 0,
     "subtract DIR/<camera>.(npy|png|tif), an image of the scene without flame"},
    {"min-views", "N", AT(frame.hull.min_views), 1, REC_MAX_CAMERAS,
     "number of cameras that must see a voxel (default 2). 1 keeps light that only one camera "
     "sees, at an unknown depth. A larger number leaves the parts of the box empty that few "
     "cameras see"},
    {"hull-rule", "inside|conservative", AT(frame.hull.keep_partial), 0, 0,
     "conservative (default): keep voxels that are partly inside the silhouettes, so no flame is "
     "lost. inside: keep only voxels that are wholly inside in every camera; this is faster, but "
     "the flame loses a rim of about a voxel and its thin parts"},
    {"no-hull", NULL, AT(no_hull), 0, 0, "for comparison: solve for every voxel that is seen"},
    {"trust-all", NULL, AT(frame.trust_all), 0, 0,
     "for comparison: use every camera. Otherwise, with four cameras or more, a camera that "
     "contradicts the others is left out of the frame, and the report lists it (out)"},
    {"anyway", NULL, AT(anyway), 0, 0,
     "write volumes even where pictures and rig do not belong together, so that they mean nothing"},
    {"save-hull", "DIR", AT(save_hull), 0, 0,
     "write a picture of each frame's hull, DIR/<6 digits>.png: voxels inside (red), partly inside "
     "(green), outside (yellow), and the silhouettes"},
    {.help = "Model:"},
    {"absorption", "off|auto|C", CLI_KEY(OPT_ABSORPTION), 0, 0,
     "the flame absorbs its own light: kappa = C times the emission, in pixel values of full scale "
     "1 (default off). auto: find the C that predicts left-out cameras best, or off where none is "
     "better; the value is printed, for `model.absorption` of the daemon"},
    {"saturated", "left-out|at-least", AT(frame.at_least), 0, 0,
     "a saturated pixel is not used (left-out, default), or means that there is at least as much "
     "light (at-least; only pcg can do it)"},
    {.help = "On several machines (--out FILE.h5):"},
    {"array", "I/N", CLI_KEY(OPT_ARRAY), 0, 0,
     "solve part I, from 1, of N parts of the recording into FILE.h5.parts. The process that ends "
     "last joins all parts into FILE.h5. For job arrays of any scheduler: --array $TASK/100"},
    {"resume", NULL, AT(resume), 0, 0,
     "continue a part that died, failed or was stopped; a part that is done stays as it is"},
    {"join", NULL, AT(join), 0, 0,
     "with --out alone: print how far the parts are, and join those that are done"},
    {"slurm", "N", AT(slurm), 1, PARTS_MAX,
     "submit N parts to Slurm as a job array, and a job that joins them; with --resume only the "
     "parts that are not done"},
    {"sbatch", "OPTIONS", AT(sbatch), 0, 0,
     "more options for sbatch, split as a shell splits them: --sbatch '--partition=long "
     "--cpus-per-task=16'. They are for the parts; the job that joins has the same, but one "
     "processor"},
    {0},
};

static void parse_array(struct argp_state *st, const char *arg, struct reconstruct_options *o)
{
    char rest;
    if (sscanf(arg, "%u/%u%c", &o->part, &o->parts, &rest) != 2 || o->part < 1 ||
        o->part > o->parts || o->parts > PARTS_MAX)
        argp_error(st, "--array: '%s' should be I/N: part I, from 1, of N", arg);
}

/* Refuse options that do not go together, where volumes go into one file. */
static void check_parts(struct argp_state *st, struct reconstruct_options *o)
{
    o->recording = o->out != NULL && vol_hdf5_name(o->out);
    bool several = o->parts > 0 || o->slurm > 0;
    if (o->join && (several || o->resume || o->plan || o->sbatch != NULL || o->report != NULL ||
                    o->save_rig != NULL))
        argp_error(st, "--join needs --out and no other option, because it solves nothing");
    if (o->plan && (several || o->resume))
        argp_error(
            st, "--plan looks at all frame sets: it cannot go with --array, --slurm or --resume");
    if ((several || o->join) && !o->recording)
        argp_error(st, "%s needs --out FILE.h5", o->join ? "--join" : "--array, --slurm");
    if (o->parts > 0 && o->slurm > 0)
        argp_error(st, "--slurm gives each part its --array: use only one of them");
    if (several && o->report != NULL)
        argp_error(st, "--save-report: the reports of parts are in FILE.h5, group /sets");
    if (o->sbatch != NULL && o->slurm == 0)
        argp_error(st, "--sbatch goes with --slurm");
}

static void check_compute(struct argp_state *st, const struct reconstruct_options *o)
{
    struct rec_frame_params p = o->frame;
    struct pvx_diag d = {""};
    enum dmn_compute_where where;
    const char *name;
    p.again = o->bars > 0;
    if (dmn_compute_allowed("--compute", o->compute, rec_frame_card_why_not(&p), &d) != PVX_OK)
        argp_error(st, "%s", d.text);
    if (o->plan && dmn_compute_parse(o->compute, &where, &name) && where == DMN_COMPUTE_OPENCL)
        argp_error(st, "--plan predicts the time on the processors: it cannot go with --compute %s",
                   o->compute);
}

static error_t reconstruct_options_parse(int key, char *arg, struct argp_state *st)
{
    static const enum rec_stop stop[] = {REC_STOP_AUTO, REC_STOP_LCURVE, REC_STOP_DISCREPANCY,
                                         REC_STOP_ITERATIONS};
    static const enum rec_selfcal_mode mode[] = {REC_SELFCAL_OFF, REC_SELFCAL_GAIN, REC_SELFCAL_ON};
    struct reconstruct_options *o = st->input;
    struct rec_solve_params *solve = &o->frame.solve;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &o->rig; return 0;
    case OPT_SOLVER:
        solve->solver = rec_solver_names()[cli_arg_choice(st, "solver", arg, rec_solver_names())];
        return 0;
    case OPT_ITER:
        solve->iterations = (uint32_t)cli_arg_whole(st, "iterations", arg, 1, 1000000);
        if (!o->stop_said)
            solve->stop = REC_STOP_ITERATIONS;
        return 0;
    case OPT_STOP:
        solve->stop = stop[cli_arg_word(st, "stop", arg, STOPS)];
        o->stop_said = true;
        return 0;
    case OPT_BARS:
        o->bars = arg != NULL ? (uint32_t)cli_arg_whole(st, "error-bars", arg, REC_BARS_LEAST,
                                                        REC_BARS_MOST)
                              : REC_BARS_USUAL;
        return 0;
    case OPT_SELFCAL: o->frame.selfcal = mode[cli_arg_word(st, "selfcal", arg, SELFCAL)]; return 0;
    case OPT_ABSORPTION:
        o->find_absorption = strcmp(arg, "auto") == 0;
        o->frame.absorption = o->find_absorption || strcmp(arg, "off") == 0
                                  ? 0
                                  : cli_arg_double(st, "absorption", arg, 0, 1e6);
        return 0;
    case OPT_MEMORY: o->memory = 1e9 * cli_arg_double(st, "memory", arg, 0, 1e9); return 0;
    case OPT_PLAN:
        o->plan = true;
        o->plan_hours = arg != NULL ? cli_arg_double(st, "plan", arg, 0.01, 1e6) : 0;
        return 0;
    case OPT_FIT:
        o->fit = true;
        if (arg != NULL)
            o->fit_margin = cli_arg_double(st, "fit-volume", arg, 0, 1e6);
        return 0;
    case OPT_ARRAY: parse_array(st, arg, o); return 0;
    case ARGP_KEY_ARG: argp_error(st, "unexpected argument '%s'", arg); return 0;
    case ARGP_KEY_END:
        check_parts(st, o);
        if (o->join)
            return 0;
        if (o->frames == NULL || o->rig.path == NULL ||
            (o->out == NULL && o->save_rig == NULL && !o->plan))
            argp_error(st, "needs --rig, --frames and --out");
        if (o->reading.means.average != NULL && o->reading.means.phases != NULL)
            argp_error(st, "--average and --phase: use only one of them");
        if (o->reading.means.n > 0 && o->reading.means.phases == NULL &&
            (o->reading.means.average == NULL || strcmp(o->reading.means.average, "all") == 0))
            argp_error(st, "--phases needs --average PERIOD or --phase FILE.csv");
        if (o->save_rig != NULL && !o->fit)
            argp_error(st, "--save-rig needs --fit-volume, because it writes the fitted volume");
        if (o->fit && o->no_hull)
            argp_error(st, "--fit-volume needs the hull: it cannot go with --no-hull");
        if (o->frame.temporal && !rec_solver_is_default(o->frame.solve.solver))
            argp_error(st, "--temporal needs the solver %s", rec_solver_names()[0]);
        if (o->bars > 0 && !rec_solver_is_default(o->frame.solve.solver))
            argp_error(st, "--error-bars needs the solver %s", rec_solver_names()[0]);
        check_compute(st, o);
        if (!dmn_choose_mosaic(o->bayer, o->frame.solve.solver, o->grey ? 1 : 3,
                               &o->reading.mosaic))
            argp_error(st, "--bayer rays needs the solver %s and three channels",
                       rec_solver_names()[0]);
        return 0;
    default: return cli_row(rows, key, arg, st, o);
    }
}

/* The solvers of this build, in --help. */
static char *help_text(int key, const char *text, void *input)
{
    (void)input;
    if (key != OPT_SOLVER)
        return (char *)text;
    const char *const *names = rec_solver_names();
    char list[300] = "";
    for (int i = 0; names[i] != NULL; i++)
        snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s%s", i == 0 ? "" : ", ",
                 names[i], i == 0 ? " (default)" : "");
    snprintf(list + strlen(list), sizeof list - strlen(list), "; the others are for comparison");
    return strdup(list);
}

/* Options that do not change the volumes.  The first ABOUT_JOBS only choose which process solves which part. */
static const struct aside {
    const char *name;
    int words; /* with its value, if that is not joined by = */
} asides[] = {{"--array", 2}, {"--resume", 1},  {"--slurm", 2},        {"--sbatch", 2},
              {"--quiet", 1}, {"--threads", 2}, {"--matrix-cache", 2}, {"--memory", 2},
              {"--out", 2},   {"--rig", 2}, /* compared by what they are, */
              {"--frames", 2}};
#define ABOUT_JOBS 5

/* Words of an option of asides[0..n), 0: it is none.  argp also takes beginnings of names. */
static int aside(const char *arg, size_t n)
{
    size_t len = strcspn(arg, "=");
    for (size_t i = 0; len > 2 && i < n; i++)
        if (strncmp(arg, asides[i].name, len) == 0)
            return arg[len] == '=' ? 1 : asides[i].words;
    return 0;
}

int reconstruct_about_jobs(const char *arg)
{
    return aside(arg, ABOUT_JOBS);
}

/* Whether both name one option, by its whole name or its beginning. */
static bool same_option(const char *a, const char *b)
{
    size_t n = strcspn(a, " \n"), m = strcspn(b, " \n");
    return strncmp(a, b, n < m ? n : m) == 0;
}

static int by_text(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* The options as sorted lines.  "--grid 64" and "--grid=64" give the same line.  If an option is given twice, the
 * last one counts, as it does for the parser. */
static char *reconstruct_said(int argc, char **argv)
{
    char **line = calloc((size_t)argc, sizeof *line), *all = calloc(1, 1);
    size_t n = 0;
    for (int i = 1; i < argc && line != NULL; i++) {
        int skip = aside(argv[i], sizeof asides / sizeof asides[0]);
        size_t name = strcspn(argv[i], "=");
        bool more = skip == 0 && argv[i][name] == '\0' && i + 1 < argc &&
                    strncmp(argv[i + 1], "--", 2) != 0;
        if (skip == 0 && asprintf(&line[n], "%.*s%s%s\n", (int)name, argv[i],
                                  argv[i][name] == '=' || more ? " " : "",
                                  argv[i][name] == '=' ? argv[i] + name + 1
                                  : more               ? argv[i + 1]
                                                       : "") >= 0) {
            size_t k = 0;
            while (k < n && !same_option(line[k], line[n]))
                k++;
            if (k < n)
                free(line[k]);
            line[k] = line[n];
            n += k == n;
        }
        i += skip > 1 || more;
    }
    if (line != NULL)
        qsort(line, n, sizeof *line, by_text);
    for (size_t i = 0; i < n; i++) {
        char *longer;
        if (all != NULL && asprintf(&longer, "%s%s", all, line[i]) >= 0) {
            free(all);
            all = longer;
        }
        free(line[i]);
    }
    free(line);
    return all;
}

#define INTRO                                                                 \
    "Reconstruct one emission volume per recorded frame set, for example\n\n" \
    "  pyrovox reconstruct --rig rig.yaml --frames take --black 0.02 --out vol"
#define EXAMPLES                                                                               \
    "Images are linear. 8-bit and 16-bit images have full scale 1.0, .npy float32 images are " \
    "used as they are. If a camera lacks a frame, the set is solved from the others. A file "  \
    "that cannot be used is named, the run continues, and the exit code is 1.\n\n"             \
    "More examples (`pyrovox simcams --write-rig rig.yaml --write-frames take` makes a "       \
    "recording for them, with a black level of 2 %):\n"                                        \
    "  pyrovox reconstruct --rig rig.yaml --frames take --black 0.02 --out vol \\\n"           \
    "          --fit-volume --grid 128 --save-report report.json\n"                            \
    "      128 voxels along the longest side of the flame, none beside it\n"                   \
    "  pyrovox reconstruct --rig rig.yaml --frames take --black 0.02 --out vol \\\n"           \
    "          --last 9 --save-hull hulls\n"                                                   \
    "      pictures of ten hulls show whether the calibration is good\n"
#define MORE                                                                         \
    "  pyrovox reconstruct --rig rig.yaml --frames take --black 0.02 \\\n"           \
    "          --fit-volume=0.05 --save-rig tight.yaml\n"                            \
    "      find the box for the daemon, solve nothing\n"                             \
    "  pyrovox reconstruct --rig rig.yaml --frames raw --black 0.02 --out vol \\\n"  \
    "          --pixel-format BayerRG8 --binning 1\n"                                \
    "      raw pictures of colour cameras, without interpolation of colours\n"       \
    "  pyrovox reconstruct --rig rig.yaml --frames take --black 0.02 --out vol \\\n" \
    "          --grid 256 --plan=12\n"                                               \
    "      does it finish in 12 hours, how much memory and disk does it need?\n"     \
    "  pyrovox reconstruct --rig rig.yaml --frames take --black 0.02 --out vol \\\n" \
    "          --deadline 100\n"                                                     \
    "      at most 100 ms of solving per frame\n"                                    \
    "  mpirun -n 8 pyrovox reconstruct --rig rig.yaml --frames night.h5 \\\n"        \
    "          --black 0.02 --out volumes.h5\n"                                      \
    "      each process solves a part, on one machine or many\n"                     \
    "  pyrovox reconstruct --rig rig.yaml --frames night.h5 \\\n"                    \
    "          --black 0.02 --out volumes.h5 --slurm 100\n"                          \
    "      the same with Slurm; `--out volumes.h5 --join` shows the progress\n"

void reconstruct_parse(int argc, char **argv, struct reconstruct_options *o)
{
    bool all = cli_help_all(
        argc, argv, "rig frames out black cameras last grid fit-volume save-report save-hull");
    const struct argp_child children[] = {{opt_rig_argp(), 0, all ? "" : NULL, all}, {0}};
    const struct argp argp = {.parser = reconstruct_options_parse,
                              .children = children,
                              .help_filter = help_text,
                              .doc = all ? INTRO "\v" EXAMPLES MORE : INTRO "\v" EXAMPLES};
    *o = (struct reconstruct_options){.rig = OPT_RIG_INIT,
                                      .compute = "cpu",
                                      .last = FRAMES_IN_LAST,
                                      .fit_margin = -1,
                                      .fit_frames = 50,
                                      .memory = -1};
    o->frame = rec_frame_defaults;
    cli_parse(rows, &argp, 0, argc, argv, o);
    o->said = reconstruct_said(argc, argv);
}
