#include "daemon/cli/experiment/options.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cli/common/arg.h"

enum { OPT_GRIDS = 0x900 };

#define AT(field) CLI_AT(struct experiment_options, field)

static const struct cli_row rows[] = {
    {"out", "DIR", AT(out), 0, 0,
     "write report.html, report.pdf, and every figure as CSV and PNG; DIR/state keeps what is "
     "done"},
    {"grids", "N,N,...", CLI_KEY(OPT_GRIDS), 0, 0,
     "voxels along the longest side in Figures 5 and 6b (default 32,48,64,72,96)"},
    {"unused", "CAMERA", AT(unused), 0, 0,
     "the camera that is left out and compared with (default: the first of the rig)"},
    {"frames-max", "N", AT(frames_max), 1, 1000000,
     "frames of Figure 5, evenly spread over the recording (default 100)"},
    {"grey", NULL, AT(grey), 0, 0, "solve one channel (colour images: the mean of the three)"},
    {"anew", NULL, AT(anew), 0, 0, "begin again: forget what DIR/state has of an earlier run"},
    FRAMES_IN_ROWS(struct experiment_options),
    FRAMES_IN_PHOTO_ROWS(struct experiment_options),
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

static error_t experiment_options_parse(int key, char *arg, struct argp_state *st)
{
    struct experiment_options *o = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &o->rig; return 0;
    case OPT_GRIDS: parse_grids(st, arg, o); return 0;
    case ARGP_KEY_ARG: cli_arg_one(st, "a recording", arg, &o->frames); return 0;
    case ARGP_KEY_END: experiment_check(st, o); return 0;
    default: return cli_row(rows, key, arg, st, o);
    }
}

static const char doc[] =
    "The experiments of the method's paper (Ihrke and Magnor, Image-Based Tomographic "
    "Reconstruction of Flames, 2004) on your own recording, for example\n\n"
    "  pyrovox experiment take --rig rig.yaml --black 0.02 --out paper\n\n"
    "A volume is reconstructed without one of the cameras and compared with the picture of that "
    "camera. No true volume is needed.\v"
    "Figures 5 and 6b: the mean difference (0 to 255) between the unused view and the volume seen "
    "from there, by frame and by grid. Figure 6a: the same with 3 to 7 views. Then the error of "
    "every solver against its time. Differences are counted where the model has light, as in the "
    "paper (6.2), and a second time also where only the picture has light.\n\n"
    "The same command continues a run that was stopped (Ctrl-C), --anew begins again. At least "
    "four cameras are needed. PNG files are read as linear.\n\n"
    "More examples (`pyrovox simcams --write-rig rig.yaml --write-frames take` makes a recording "
    "for them, with a black level of 2 %):\n"
    "  pyrovox experiment take --rig rig.yaml --black 0.02 --out quick \\\n"
    "          --grids 24,32,48 --grid 32 --frames-max 10\n"
    "      a first result within a minute\n"
    "  pyrovox experiment take.h5 --rig rig.yaml --black 0.02 --out cam5 \\\n"
    "          --unused cam5\n"
    "      the same with another unused view\n";

void experiment_parse(int argc, char **argv, struct experiment_options *o)
{
    const struct argp_child children[] = {{opt_rig_argp(), 0, "", 1}, {0}};
    const struct argp argp = {
        .parser = experiment_options_parse, .args_doc = "FRAMES", .children = children, .doc = doc};
    *o = (struct experiment_options){.rig = OPT_RIG_INIT,
                                     .grids = {32, 48, 64, 72, 96},
                                     .n_grids = 5,
                                     .grid = 64,
                                     .last = FRAMES_IN_LAST,
                                     .frames_max = 100};
    o->frame = rec_frame_defaults;
    o->frame.trust_all = true; /* an experiment must show a wrong camera, not hide it */
    cli_parse(rows, &argp, 0, argc, argv, o);
}
