#include "daemon/cli/experiment/options.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cli/common/arg.h"

enum {
    OPT_OUT = 0x900,
    OPT_GRIDS,
    OPT_UNUSED,
    OPT_FRAMES_MAX,
    OPT_FIRST,
    OPT_LAST,
    OPT_THRESHOLD,
    OPT_BLACK,
    OPT_MARGIN,
    OPT_GREY,
    OPT_FORMAT,
    OPT_TRANSFER,
    OPT_ANEW,
    OPT_QUIET
};

static const struct argp_option option_table[] = {
    {"out", OPT_OUT, "DIR", 0,
     "report.html, report.pdf, and every figure as CSV and PNG; DIR/state keeps what is done", 0},
    {"grids", OPT_GRIDS, "N,N,...", 0,
     "Figures 5 and 6b: voxels along the longest side (default 32,48,64,72,96)", 0},
    {"unused", OPT_UNUSED, "CAMERA", 0,
     "the view that is left out and compared with (default: the rig's first camera)", 0},
    {"frames-max", OPT_FRAMES_MAX, "N", 0,
     "frames of Figure 5, evenly spread over the recording (default 100)", 0},
    {"first", OPT_FIRST, "N", 0, "first frame number", 0},
    {"last", OPT_LAST, "N", 0, "last frame number", 0},
    {"threshold", OPT_THRESHOLD, "X|auto", 0, "flame is >= X of full scale (auto: from the noise)",
     0},
    {"black", OPT_BLACK, "X", 0, "black level, share of full scale (default 0)", 0},
    {"margin", OPT_MARGIN, "N", 0, "grow silhouettes by N bins (default 0)", 0},
    {"grey", OPT_GREY, NULL, 0, "one channel (colour images: their mean)", 0},
    {"pixel-format", OPT_FORMAT, "NAME", 0, "what grey images are: BayerRG8, Mono12 ...", 0},
    {"transfer", OPT_TRANSFER, "auto|linear|srgb|bt709", 0,
     "how samples stand for light (auto: JPEG files srgb, all others linear)", 0},
    {"anew", OPT_ANEW, NULL, 0, "forget what DIR/state has of an earlier run", 0},
    {"quiet", OPT_QUIET, NULL, 0, "no progress", 0},
    {0},
};

static int experiment_rising(const void *a, const void *b)
{
    return *(const int32_t *)a - *(const int32_t *)b;
}

static void parse_grids(struct argp_state *st, const char *arg, struct experiment_options *o)
{
    char text[256];
    o->n_grids = 0;
    if (strlen(arg) >= sizeof text)
        argp_error(st, "--grids: at most %d of them", EXPERIMENT_GRIDS);
    snprintf(text, sizeof text, "%s", arg);
    for (char *save = NULL, *s = strtok_r(text, ",", &save); s != NULL;
         s = strtok_r(NULL, ",", &save)) {
        int64_t n = 0;
        if (o->n_grids == EXPERIMENT_GRIDS)
            argp_error(st, "--grids: at most %d of them", EXPERIMENT_GRIDS);
        cli_arg_int(st, "grids", s, 8, 512, &n);
        o->grids[o->n_grids++] = (int32_t)n;
    }
    if (o->n_grids == 0)
        argp_error(st, "--grids %s: should be numbers of voxels, as 32,64", arg);
    qsort(o->grids, (size_t)o->n_grids, sizeof *o->grids, experiment_rising);
    for (int i = 1; i < o->n_grids; i++)
        if (o->grids[i] == o->grids[i - 1])
            argp_error(st, "--grids %s: %d is there twice", arg, o->grids[i]);
}

static void experiment_check(struct argp_state *st, struct experiment_options *o)
{
    if (o->frames == NULL || o->rig.path == NULL || o->out == NULL)
        argp_error(st, "needs FRAMES, --rig and --out");
    if (o->rig.grid_auto || (o->rig.grid[0] != 0 && !o->rig.grid_one))
        argp_error(st, "--grid is one number here: voxels along the longest side");
    if (o->rig.grid[0] != 0)
        o->grid = o->rig.grid[0];
    if (o->grid < 8 || o->grid > 512)
        argp_error(st, "--grid %d: should be 8 to 512", o->grid);
    memset(o->rig.grid, 0, sizeof o->rig.grid);
}

static error_t parse_pictures(int key, char *arg, struct argp_state *st)
{
    struct experiment_options *o = st->input;
    struct rec_photo_params *photo = &o->frame.photo;
    switch (key) {
    case OPT_THRESHOLD:
        photo->threshold =
            strcmp(arg, "auto") == 0 ? -1 : (float)cli_arg_double(st, "threshold", arg, 0, 1e6);
        return 0;
    case OPT_BLACK: photo->black = (float)cli_arg_double(st, "black", arg, 0, 1); return 0;
    case OPT_MARGIN: photo->margin = (int32_t)cli_arg_whole(st, "margin", arg, 0, 64); return 0;
    case OPT_GREY: o->grey = true; return 0;
    case OPT_FORMAT: o->reading.fmt = cli_arg_pixfmt(st, arg); return 0;
    case OPT_TRANSFER: o->reading.transfer = cli_arg_transfer(st, arg); return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static error_t experiment_options_parse(int key, char *arg, struct argp_state *st)
{
    struct experiment_options *o = st->input;
    int64_t v = 0;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &o->rig; return 0;
    case OPT_OUT: o->out = arg; return 0;
    case OPT_GRIDS: parse_grids(st, arg, o); return 0;
    case OPT_UNUSED: o->unused = arg; return 0;
    case OPT_FRAMES_MAX:
        cli_arg_int(st, "frames-max", arg, 1, 1000000, &v);
        o->frames_max = (uint32_t)v;
        return 0;
    case OPT_FIRST:
        cli_arg_int(st, "first", arg, 0, FRAMES_IN_LAST, &v);
        o->first = (uint32_t)v;
        return 0;
    case OPT_LAST:
        cli_arg_int(st, "last", arg, 0, FRAMES_IN_LAST, &v);
        o->last = (uint32_t)v;
        return 0;
    case OPT_ANEW: o->anew = true; return 0;
    case OPT_QUIET: o->quiet = true; return 0;
    case ARGP_KEY_ARG: cli_arg_one(st, "a recording", arg, &o->frames); return 0;
    case ARGP_KEY_END: experiment_check(st, o); return 0;
    default: return parse_pictures(key, arg, st);
    }
}

static const char doc[] =
    "The experiments of the paper on a recording of yours: how well does a volume, reconstructed "
    "without one of the cameras, show what that camera saw?  No truth is needed.\v"
    "Figure 5, 6b: the mean difference (0 to 255) between the unused view and the volume seen from "
    "there, by frame and by grid.  Figure 6a: the same with 3 to 7 views.  Then the error of every "
    "solver against its time.  Differences are counted where the model has light (the paper, 6.2, "
    "leaves out what is beside its silhouette), and once more also where only the picture has.\n\n"
    "The same command goes on where it was stopped (Ctrl-C); --anew begins from nothing.  At "
    "least four cameras are needed.  PNG files are taken to be linear.\n\n"
    "Examples (`pyrovox simcams --write-rig rig.yaml --write-frames take` makes a recording to try "
    "them on, with --black 0.02):\n"
    "  pyrovox experiment take --rig rig.yaml --out paper\n"
    "      all of it, as in the paper\n"
    "  pyrovox experiment take --rig rig.yaml --out quick \\\n"
    "          --grids 24,32,48 --grid 32 --frames-max 10\n"
    "      a first look within a minute\n"
    "  pyrovox experiment take.h5 --rig rig.yaml --out cam5 --unused cam5\n"
    "      does another view say the same?\n";

void experiment_parse(int argc, char **argv, struct experiment_options *o)
{
    static const struct argp_child children[] = {{&opt_rig_argp, 0, "", 1}, {0}};
    static const struct argp argp = {.options = option_table,
                                     .parser = experiment_options_parse,
                                     .args_doc = "FRAMES",
                                     .children = children,
                                     .doc = doc};
    *o = (struct experiment_options){.rig = OPT_RIG_INIT,
                                     .grids = {32, 48, 64, 72, 96},
                                     .n_grids = 5,
                                     .grid = 64,
                                     .last = FRAMES_IN_LAST,
                                     .frames_max = 100};
    o->frame = rec_frame_defaults;
    o->frame.trust_all = true; /* an experiment is to show a camera that is wrong, not hide it */
    argp_parse(&argp, argc, argv, 0, NULL, o);
}
