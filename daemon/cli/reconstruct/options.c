#include "daemon/cli/reconstruct/options.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/reconstruct/parts.h"
#include "daemon/config/config.h"
#include "daemon/volumes/volumes.h"

enum {
    OPT_FRAMES = 0x100,
    OPT_OUT,
    OPT_REPORT,
    OPT_SOLVER,
    OPT_ITER,
    OPT_STOP,
    OPT_LAMBDA,
    OPT_TOLERANCE,
    OPT_DEADLINE,
    OPT_FIRST,
    OPT_LAST,
    OPT_THRESHOLD,
    OPT_MARGIN,
    OPT_BLACK,
    OPT_MIN_VIEWS,
    OPT_HULL_RULE,
    OPT_STRICT,
    OPT_NO_HULL,
    OPT_TRUST_ALL,
    OPT_ABSORPTION,
    OPT_SATURATED,
    OPT_TEMPORAL,
    OPT_SAVE_HULL,
    OPT_BACKGROUND,
    OPT_GREY,
    OPT_FORMAT,
    OPT_TRANSFER,
    OPT_BAYER,
    OPT_START,
    OPT_WARM,
    OPT_CACHE,
    OPT_QUIET,
    OPT_FIT,
    OPT_FIT_FRAMES,
    OPT_SAVE_RIG,
    OPT_MEMORY,
    OPT_PLAN,
    OPT_ARRAY,
    OPT_RESUME,
    OPT_JOIN,
    OPT_SLURM,
    OPT_SBATCH
};

static const struct argp_option option_table[] = {
    {"frames", OPT_FRAMES, "DIR|TAKE.h5", 0,
     "DIR/<camera>/<6 digits>.(npy|png|tif), or a take of raw frames, FILE.h5", 0},
    {"out", OPT_OUT, "DIR|FILE.h5", 0,
     "volumes go to DIR/<6 digits>.npy with a .json beside each, or into one HDF5 file", 0},
    {"save-report", OPT_REPORT, "FILE", 0, "solver and hull report of every frame as JSON", 0},
    {"first", OPT_FIRST, "N", 0, "first frame number", 0},
    {"last", OPT_LAST, "N", 0, "last frame number", 0},
    {"grey", OPT_GREY, NULL, 0, "solve one channel (colour images: their mean)", 0},
    {"pixel-format", OPT_FORMAT, "NAME", 0,
     "what grey images are: BayerRG8 for raw pictures of a colour camera, Mono12 for 12 bits in 16 "
     "...",
     0},
    {"bayer", OPT_BAYER, "auto|rays|demosaic", 0,
     "Bayer pixels at binning 1: each a ray of its own colour (rays; auto, where the solver can), "
     "or with the missing colours interpolated",
     0},
    {"transfer", OPT_TRANSFER, "auto|linear|srgb|bt709", 0,
     "how samples stand for light (auto: JPEG files srgb, all others linear)", 0},
    {"matrix-cache", OPT_CACHE, "FILE", 0, "where the system matrix is kept (default: user cache)",
     0},
    {"memory", OPT_MEMORY, "GB", 0,
     "memory to use (default: four fifths of what is free). Where the whole system matrix would "
     "take "
     "more, only its part where the frame sets have flame is built, found from their silhouettes: "
     "the same volumes, but nothing is cached. 0: only that part, however much it takes",
     0},
    {"plan", OPT_PLAN, "HOURS", OPTION_ARG_OPTIONAL,
     "reconstruct nothing, but say what it would take: time, memory and disk, stage by stage, from "
     "about a minute of it; and how many machines like this one would be done in HOURS",
     0},
    {"quiet", OPT_QUIET, NULL, 0, "no progress", 0},
    {NULL, 0, NULL, 0, "Volume fitted to the flame:", 2},
    {"fit-volume", OPT_FIT, "MARGIN", OPTION_ARG_OPTIONAL,
     "reconstruct in the tightest box around the flame of the whole recording, found from the "
     "silhouettes, plus MARGIN metres on every side (default: about 1/48 of the rig's box). Voxels "
     "keep the rig's size; --grid N puts N along the longest side instead, --grid auto "
     "the finest that the pictures hold",
     2},
    {"fit-frames", OPT_FIT_FRAMES, "N|all", 0,
     "frame sets to look at for it, evenly spread (default 50)", 2},
    {"save-rig", OPT_SAVE_RIG, "FILE", 0,
     "write the rig with the fitted volume, for the daemon; without --out that is all", 2},
    {NULL, 0, NULL, 0, "Solver:", 3},
    {"solver", OPT_SOLVER, "NAME", 0, "one of", 3},
    {"iterations", OPT_ITER, "N", 0, "at most N; without --stop exactly the budget", 3},
    {"stop", OPT_STOP, "RULE", 0,
     "auto (default: pcg, when an iteration gains next to nothing; the others, when the residual "
     "is down to the noise), lcurve (corner of the L-curve), discrepancy (residual down to the "
     "noise, which is measured beside the flame) or iterations (the budget, no less)",
     3},
    {"tolerance", OPT_TOLERANCE, "X", 0,
     "--stop auto of pcg: the share by which an iteration must move the volume, or half of it the "
     "objective (default 0.006)",
     3},
    {"deadline", OPT_DEADLINE, "MS", 0,
     "stop after MS milliseconds of solving at the latest and keep the best iterate by then", 3},
    {"start", OPT_START, "cold|warm", 0,
     "by itself (default) or from the frame before, where that fits better than what coarser grids "
     "give; the report says which it was",
     3},
    {"lambda", OPT_LAMBDA, "X", 0, "weight of the smoothness term (default: from the pictures)", 3},
    {"temporal", OPT_TEMPORAL, "before|both", OPTION_ARG_OPTIONAL,
     "expect what the frame before (default) says, moved along the flame's motion, as far as the "
     "pictures bear it out: for noisy pictures (5 %) of a flame that moves slowly; off after a "
     "jump. "
     "both: then once more from the last frame to the first, and the mean of the two, in twice the "
     "time. Only pcg does",
     3},
    {NULL, 0, NULL, 0, "Silhouettes and hull:", 4},
    {"threshold", OPT_THRESHOLD, "X|auto", 0, "flame is >= X of full scale (auto: from the noise)",
     4},
    {"black", OPT_BLACK, "X", 0, "black level, share of full scale (default 0)", 4},
    {"background", OPT_BACKGROUND, "DIR", 0,
     "subtract DIR/<camera>.(npy|png|tif), an image of the scene without flame", 4},
    {"margin", OPT_MARGIN, "N", 0,
     "grow silhouettes by N bins (default 0). Raise it by the calibration error in bins: too small "
     "cuts the flame's rim off, too large costs time and lets light leak outwards",
     4},
    {"min-views", OPT_MIN_VIEWS, "N", 0,
     "cameras that must see a voxel (default 2). Fewer: 1 keeps what one camera alone sees, of "
     "unknown depth; more: parts of the box that few cameras see stay empty",
     4},
    {"hull-rule", OPT_HULL_RULE, "RULE", 0,
     "conservative (default): keep voxels that are partly inside the silhouettes, no flame is "
     "lost; inside: only those wholly inside in every camera: fewer voxels, faster, but the flame "
     "loses a rim of about a voxel and thin parts altogether",
     4},
    {"no-hull", OPT_NO_HULL, NULL, 0, "for comparison: solve for every voxel that is seen", 4},
    {"trust-all", OPT_TRUST_ALL, NULL, 0,
     "for comparison: believe every camera. Without it, and with four cameras or more, one that "
     "contradicts the others is left out of the frame, named, and listed in the report (out)",
     4},
    {"save-hull", OPT_SAVE_HULL, "DIR", 0,
     "a picture of each frame's hull, DIR/<6 digits>.png: voxels inside (red), partly inside "
     "(green), outside (yellow), and the silhouettes they come from",
     4},
    {NULL, 0, NULL, 0, "Model:", 5},
    {"absorption", OPT_ABSORPTION, "off|auto|C", 0,
     "soot absorbs what burns behind it: kappa = C times the emission, in pixel values of full "
     "scale "
     "1. auto: the C that shows left-out cameras best, off where that is no gain; it is said, for "
     "`model.absorption` of the daemon. Default off",
     5},
    {"saturated", OPT_SATURATED, "left-out|at-least", 0,
     "what a saturated pixel says: nothing (default), or that it is at least as bright as that, "
     "which "
     "only the solver pcg knows how to use",
     5},
    {NULL, 0, NULL, 0, "On several machines (--out FILE.h5):", 6},
    {"array", OPT_ARRAY, "I/N", 0,
     "solve part I, from 1, of N runs of the recording's sets, into FILE.h5.parts; whoever ends "
     "last joins "
     "them into FILE.h5. For job arrays of any scheduler: --array $TASK/100",
     6},
    {"resume", OPT_RESUME, NULL, 0,
     "go on with a part that died, failed or was stopped; one that is done is left alone", 6},
    {"join", OPT_JOIN, NULL, 0,
     "with --out alone: show how far the parts are, and join those that are done", 6},
    {"slurm", OPT_SLURM, "N", 0,
     "hand N parts to Slurm as a job array, and a job that joins them; with --resume only what is "
     "not "
     "done",
     6},
    {"sbatch", OPT_SBATCH, "OPTIONS", 0,
     "more for sbatch, split as a shell does: --sbatch '--partition=long --cpus-per-task=16'. For "
     "the parts; the job that joins them is given the same, but one processor",
     6},
    /* earlier names */
    {"strict-hull", OPT_STRICT, NULL, OPTION_HIDDEN, NULL, 4},
    {"warm-start", OPT_WARM, NULL, OPTION_HIDDEN, NULL, 3},
    {"deadline-ms", OPT_DEADLINE, "MS", OPTION_HIDDEN, NULL, 3},
    {0},
};

/* Place of `arg` in a NULL-terminated list of names. */

static error_t parse_rest(int key, char *arg, struct argp_state *st)
{
    static const char *const stops[] = {"auto", "lcurve", "discrepancy", "iterations", NULL};
    static const enum rec_stop stop[] = {REC_STOP_AUTO, REC_STOP_LCURVE, REC_STOP_DISCREPANCY,
                                         REC_STOP_ITERATIONS};
    static const char *const starts[] = {"cold", "warm", NULL};
    static const char *const temporal[] = {"before", "both", NULL};
    static const char *const saturated[] = {"left-out", "at-least", NULL};
    static const char *const rules[] = {"inside", "conservative", NULL};
    struct reconstruct_options *o = st->input;
    struct rec_solve_params *solve = &o->frame.solve;
    struct rec_photo_params *photo = &o->frame.photo;
    struct rec_hull_params *hull = &o->frame.hull;
    switch (key) {
    case OPT_SOLVER:
        solve->solver = rec_solver_names()[cli_arg_choice(st, "solver", arg, rec_solver_names())];
        return 0;
    case OPT_ITER:
        solve->iterations = (uint32_t)cli_arg_whole(st, "iterations", arg, 1, 1000000);
        if (!o->stop_said)
            solve->stop = REC_STOP_ITERATIONS;
        return 0;
    case OPT_STOP:
        solve->stop = stop[cli_arg_choice(st, "stop", arg, stops)];
        o->stop_said = true;
        return 0;
    case OPT_LAMBDA: solve->lambda = (float)cli_arg_double(st, "lambda", arg, 0, 1e6); return 0;
    case OPT_TOLERANCE:
        solve->tolerance = (float)cli_arg_double(st, "tolerance", arg, 0, 1);
        return 0;
    case OPT_DEADLINE: o->deadline_ms = cli_arg_double(st, "deadline", arg, 0.01, 1e9); return 0;
    case OPT_START: o->warm = cli_arg_choice(st, "start", arg, starts) == 1; return 0;
    case OPT_WARM: o->warm = true; return 0;
    case OPT_THRESHOLD:
        photo->threshold =
            strcmp(arg, "auto") == 0 ? -1 : (float)cli_arg_double(st, "threshold", arg, 0, 1e6);
        return 0;
    case OPT_BLACK: photo->black = (float)cli_arg_double(st, "black", arg, 0, 1); return 0;
    case OPT_MARGIN: photo->margin = (int32_t)cli_arg_whole(st, "margin", arg, 0, 64); return 0;
    case OPT_MIN_VIEWS:
        hull->min_views = (uint32_t)cli_arg_whole(st, "min-views", arg, 1, REC_MAX_CAMERAS);
        return 0;
    case OPT_HULL_RULE: hull->keep_partial = cli_arg_choice(st, "hull-rule", arg, rules); return 0;
    case OPT_STRICT: hull->keep_partial = 0; return 0;
    case OPT_NO_HULL: o->no_hull = true; return 0;
    case OPT_TEMPORAL:
        o->frame.temporal = true;
        o->both = arg != NULL && cli_arg_choice(st, "temporal", arg, temporal) == 1;
        return 0;
    case OPT_TRUST_ALL: o->frame.trust_all = true; return 0;
    case OPT_SATURATED:
        o->frame.at_least = cli_arg_choice(st, "saturated", arg, saturated) == 1;
        return 0;
    case OPT_ABSORPTION:
        o->find_absorption = strcmp(arg, "auto") == 0;
        o->frame.absorption = o->find_absorption || strcmp(arg, "off") == 0
                                  ? 0
                                  : cli_arg_double(st, "absorption", arg, 0, 1e6);
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static void parse_array(struct argp_state *st, const char *arg, struct reconstruct_options *o)
{
    char rest;
    if (sscanf(arg, "%u/%u%c", &o->part, &o->parts, &rest) != 2 || o->part < 1 ||
        o->part > o->parts || o->parts > PARTS_MAX)
        argp_error(st, "--array: '%s' should be I/N: part I, from 1, of N", arg);
}

/* What goes with what, where volumes go into one file. */
static void check_parts(struct argp_state *st, struct reconstruct_options *o)
{
    o->recording = o->out != NULL && vol_hdf5_name(o->out);
    bool several = o->parts > 0 || o->slurm > 0;
    if (o->join && (several || o->resume || o->plan || o->sbatch != NULL || o->report != NULL ||
                    o->save_rig != NULL))
        argp_error(st, "--join solves nothing: it goes with --out alone");
    if (o->plan && (several || o->resume))
        argp_error(st, "--plan is of all frame sets: not with --array, --slurm or --resume");
    if ((several || o->join) && !o->recording)
        argp_error(st, "%s needs --out FILE.h5", o->join ? "--join" : "--array, --slurm");
    if (o->parts > 0 && o->slurm > 0)
        argp_error(st, "--slurm says --array to each part itself");
    if (several && o->report != NULL)
        argp_error(st, "--save-report: of parts the reports are in FILE.h5, /sets");
    if (o->recording && o->both)
        argp_error(st, "--temporal=both needs a folder: --out DIR");
    if (o->sbatch != NULL && o->slurm == 0)
        argp_error(st, "--sbatch goes with --slurm");
}

static error_t reconstruct_options_parse(int key, char *arg, struct argp_state *st)
{
    static const char *const bayers[] = {"auto", "rays", "demosaic", NULL};
    struct reconstruct_options *o = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &o->rig; return 0;
    case OPT_FRAMES: o->frames = arg; return 0;
    case OPT_OUT: o->out = arg; return 0;
    case OPT_REPORT: o->report = arg; return 0;
    case OPT_CACHE: o->cache = arg; return 0;
    case OPT_FIRST:
        o->first = (uint32_t)cli_arg_whole(st, "first", arg, 0, FRAMES_IN_LAST);
        return 0;
    case OPT_LAST: o->last = (uint32_t)cli_arg_whole(st, "last", arg, 0, FRAMES_IN_LAST); return 0;
    case OPT_GREY: o->grey = true; return 0;
    case OPT_FORMAT: o->reading.fmt = cli_arg_pixfmt(st, arg); return 0;
    case OPT_TRANSFER: o->reading.transfer = cli_arg_transfer(st, arg); return 0;
    case OPT_BAYER: o->bayer = cli_arg_choice(st, "bayer", arg, bayers); return 0;
    case OPT_MEMORY: o->memory = 1e9 * cli_arg_double(st, "memory", arg, 0, 1e9); return 0;
    case OPT_PLAN:
        o->plan = true;
        o->plan_hours = arg != NULL ? cli_arg_double(st, "plan", arg, 0.01, 1e6) : 0;
        return 0;
    case OPT_QUIET: o->quiet = true; return 0;
    case OPT_BACKGROUND: o->background = arg; return 0;
    case OPT_SAVE_HULL: o->save_hull = arg; return 0;
    case OPT_FIT:
        o->fit = true;
        if (arg != NULL)
            o->fit_margin = cli_arg_double(st, "fit-volume", arg, 0, 1e6);
        return 0;
    case OPT_FIT_FRAMES:
        o->fit_frames =
            strcmp(arg, "all") == 0 ? 0 : (uint32_t)cli_arg_whole(st, "fit-frames", arg, 1, 999999);
        return 0;
    case OPT_SAVE_RIG: o->save_rig = arg; return 0;
    case OPT_ARRAY: parse_array(st, arg, o); return 0;
    case OPT_RESUME: o->resume = true; return 0;
    case OPT_JOIN: o->join = true; return 0;
    case OPT_SLURM: o->slurm = (unsigned)cli_arg_whole(st, "slurm", arg, 1, PARTS_MAX); return 0;
    case OPT_SBATCH: o->sbatch = arg; return 0;
    case ARGP_KEY_ARG: argp_error(st, "unexpected argument '%s'", arg); return 0;
    case ARGP_KEY_END:
        check_parts(st, o);
        if (o->join)
            return 0;
        if (o->frames == NULL || o->rig.path == NULL ||
            (o->out == NULL && o->save_rig == NULL && !o->plan))
            argp_error(st, "needs --rig, --frames and --out");
        if (o->save_rig != NULL && !o->fit)
            argp_error(st, "--save-rig writes the fitted volume: it needs --fit-volume");
        if (o->fit && o->no_hull)
            argp_error(st, "--fit-volume comes from the hull: it cannot go with --no-hull");
        if (o->frame.temporal && !rec_solver_is_default(o->frame.solve.solver))
            argp_error(st, "--temporal needs the solver %s", rec_solver_names()[0]);
        if (!dmn_choose_mosaic(o->bayer, o->frame.solve.solver, o->grey ? 1 : 3,
                               &o->reading.mosaic))
            argp_error(st, "--bayer rays needs the solver %s and three channels",
                       rec_solver_names()[0]);
        return 0;
    default: return parse_rest(key, arg, st);
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
    snprintf(list + strlen(list), sizeof list - strlen(list),
             "; all but the first are for comparison");
    return strdup(list);
}

/* Options that have no bearing on the volumes, nor where they are made; those that only say who makes which are first. */
static const struct aside {
    const char *name;
    int words; /* with its value, if that is not joined by = */
} asides[] = {{"--array", 2}, {"--resume", 1},  {"--slurm", 2},        {"--sbatch", 2},
              {"--quiet", 1}, {"--threads", 2}, {"--matrix-cache", 2}, {"--memory", 2},
              {"--out", 2},   {"--rig", 2}, /* compared by what they are, */
              {"--frames", 2}};
#define ABOUT_JOBS 5

/* argp takes beginnings of names too. */
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

/* Both name one option, whole or by its beginning. */
static bool same_option(const char *a, const char *b)
{
    size_t n = strcspn(a, " \n"), m = strcspn(b, " \n");
    return strncmp(a, b, n < m ? n : m) == 0;
}

static int by_text(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* "--grid 64" and "--grid=64" are one line, in whatever order they were said; of one that is said twice the last counts, as
 * it does for the parser. */
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

void reconstruct_parse(int argc, char **argv, struct reconstruct_options *o)
{
    static const struct argp_child children[] = {{&opt_rig_argp, 0, "", 1}, {0}};
    static const struct argp argp = {
        .options = option_table,
        .parser = reconstruct_options_parse,
        .children = children,
        .help_filter = help_text,
        .doc = "Reconstruct one emission volume per recorded frame set.\vImages are linear: "
               "8/16-bit with full scale 1.0, .npy float32 as it is. A frame that some camera "
               "lacks is solved from the others; a file that cannot be used is named, the rest "
               "goes on, and the exit code is 1.\n\n"
               "Examples (`pyrovox simcams --write-rig rig.yaml --write-frames take` makes a "
               "recording to try them on, with --black 0.02):\n"
               "  pyrovox reconstruct --rig rig.yaml --frames take --out vol\n"
               "      one volume per frame on the rig's grid\n"
               "  pyrovox reconstruct --rig rig.yaml --frames take --out vol \\\n"
               "          --fit-volume --grid 128 --save-report report.json\n"
               "      128 voxels along the flame's height, none wasted beside it\n"
               "  pyrovox reconstruct --rig rig.yaml --frames take \\\n"
               "          --fit-volume=0.05 --save-rig tight.yaml\n"
               "      only find the box, for the daemon\n"
               "  pyrovox reconstruct --rig rig.yaml --frames take --out vol \\\n"
               "          --last 9 --save-hull hulls\n"
               "      is the calibration good?  Look at the hulls of ten frames\n"
               "  pyrovox reconstruct --rig rig.yaml --frames raw --out vol \\\n"
               "          --pixel-format BayerRG8 --binning 1\n"
               "      raw pictures of colour cameras, each pixel used as it is\n"
               "  pyrovox reconstruct --rig rig.yaml --frames take --out vol --grid 256 \\\n"
               "          --plan=12\n"
               "      will it be done in 12 hours, how much memory and disk?\n"
               "  pyrovox reconstruct --rig rig.yaml --frames take --out vol \\\n"
               "          --deadline 100\n"
               "      within 100 ms of solving per frame\n"
               "  mpirun -n 8 pyrovox reconstruct --rig rig.yaml --frames night.h5 \\\n"
               "          --out volumes.h5\n"
               "      every process a part, on one machine or many\n"
               "  pyrovox reconstruct --rig rig.yaml --frames night.h5 \\\n"
               "          --out volumes.h5 --slurm 100\n"
               "      the same by Slurm; `--out volumes.h5 --join` shows how far it is\n"};
    *o = (struct reconstruct_options){.rig = OPT_RIG_INIT,
                                      .last = FRAMES_IN_LAST,
                                      .fit_margin = -1,
                                      .fit_frames = 50,
                                      .memory = -1};
    o->frame = rec_frame_defaults;
    argp_parse(&argp, argc, argv, 0, NULL, o);
    o->said = reconstruct_said(argc, argv);
}
