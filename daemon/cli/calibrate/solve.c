/* solve.c - `pyrovox calibrate solve`: from pictures of a board to rig.yaml. */
#include <stdio.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/job.h"
#include "daemon/cli/calibrate/modes.h"
#include "daemon/cli/common/cli.h"

struct args {
    struct calibrate_args c;
    const char *frames;
    int64_t every, from, to; /* every 0: not given */
    int numbers;             /* enum cap_numbers */
    const char *binning[REC_MAX_CAMERAS], *region[REC_MAX_CAMERAS];
    size_t n_binning, n_region;
};

enum { OPT_NUMBERS = 0x100, OPT_BINNING, OPT_REGION };

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"frames", "DIR", AT(frames), 0, 0,
     "DIR/<camera>/<number>.(png|tif|jpg|npy), pictures of one instant have one number; or videos "
     "whose times begin together, DIR/<camera>.(mp4|avi|mkv|mov); or a take, FILE.h5"},
    {"numbers", CAP_NUMBERS, CLI_KEY(OPT_NUMBERS), 0, 0,
     "what the numbers of pictures are: count (default), or times of the cameras' common clock, "
     "which are paired to half a frame period"},
    {"every", "N", AT(every), 1, 1000000,
     "of every N frames of videos, or sets of a take, look at the one in which the least moves "
     "(default: so that 200 are looked at; 1: all)"},
    {"from", "NUMBER", AT(from), 0, REC_NO_FRAME - 1,
     "only pictures of this number and later ones"},
    {"to", "NUMBER", AT(to), 0, REC_NO_FRAME - 1, "only pictures up to this number"},
    {"binning", "N[,CAMERA]", CLI_KEY(OPT_BINNING), 0, 0,
     "the flame is taken with N x N pixels as one, these pictures are not; may be repeated"},
    {"region", "X,Y,W,H[,CAMERA]", CLI_KEY(OPT_REGION), 0, 0,
     "pictures of the flame are these W x H pixels, after binning, of the whole ones, which these "
     "are; may be repeated"},
    {0}};

static const char doc[] =
    "Make rig.yaml from pictures of a calibration board.\vExamples:\n"
    "  pyrovox calibrate solve --frames pictures \\\n"
    "          --board charuco:8x11:0.03:0.022:two-sided \\\n"
    "          --volume -0.5,-0.5,0,0.5,0.5,1 --floor 0 --out rig.yaml\n"
    "\n"
    "The five steps:\n"
    "  1. Print a board, two-sided if cameras stand all around:\n"
    "     pyrovox calibrate board charuco:8x11:0.03:0.022 --two-sided \\\n"
    "          --out board.pdf\n"
    "  2. Fix cameras, focus, zoom, binning and region as they will be. Use short exposures.\n"
    "  3. Lay the board flat where the middle of the volume's floor is. Take one picture with all "
    "cameras at the same instant: number 0.\n"
    "  4. Show the board in 30 to 100 more poses, each with all cameras at the same instant. Go "
    "all through the volume, tilt the board by up to 60 degrees each way, reach the corners of "
    "every picture, and stand between neighbouring cameras, so that two see it together.\n"
    "  5. Solve, read the verdict, and add the poses that it asks for.\n"
    "\n"
    "The expected error is that of projections all through the volume, not of the corners that "
    "were seen. Tomography tolerates 0.10 to 0.15 voxels. single px is how well each camera agrees "
    "with itself, joint px how well all agree. If the second is much larger, something moved or "
    "the cameras do not expose together.\n"
    "Exit code 1, and no rig is written, if the rig should not be believed. --accept writes it.";

static void solve_keep(struct argp_state *st, const char **list, size_t *n, const char *arg)
{
    if (*n == REC_MAX_CAMERAS)
        argp_error(st, "%s: once a camera is enough", arg);
    else
        list[(*n)++] = arg;
}

static error_t solve_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &a->c; return 0;
    case OPT_NUMBERS: a->numbers = cli_arg_word(st, "numbers", arg, CAP_NUMBERS); return 0;
    case OPT_BINNING: solve_keep(st, a->binning, &a->n_binning, arg); return 0;
    case OPT_REGION: solve_keep(st, a->region, &a->n_region, arg); return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': this step takes options only", arg); return 0;
    case ARGP_KEY_END:
        if (a->frames == NULL)
            argp_error(st, "which pictures? --frames DIR");
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static pvx_err solve_run(struct calibrate_job *j, const struct args *a, struct pvx_diag *d)
{
    pvx_pool *pool;
    PVX_TRY(calibrate_start(j, &a->c, d));
    PVX_TRY(calibrate_find(&j->look, a->frames, (enum cap_numbers)a->numbers, d));
    if (a->every > 0 && j->look.source == CALIBRATE_FOLDERS)
        return pvx_fail(
            d, PVX_EINVAL,
            "--every is for videos and takes; in %s there are single pictures, and all of "
            "them are looked at",
            a->frames);
    j->look.every = (uint32_t)a->every;
    j->look.from = (uint32_t)a->from;
    j->look.to = (uint32_t)a->to;
    if (a->c.floor >= 0 && (a->c.floor < a->from || a->c.floor > a->to))
        return pvx_fail(d, PVX_EINVAL,
                        "--floor %lld is not among the pictures of --from and --to, which are all "
                        "that is looked at",
                        (long long)a->c.floor);
    if (a->c.floor >= 0)
        j->look.always = (uint32_t)a->c.floor;
    for (size_t i = 0; i < a->n_binning; i++)
        PVX_TRY(calibrate_mode_binning(&j->look, a->binning[i], d));
    for (size_t i = 0; i < a->n_region; i++)
        PVX_TRY(calibrate_mode_region(&j->look, a->region[i], d));
    PVX_TRY(calibrate_prepare(j, d));
    PVX_TRY(pvx_pool_new((unsigned)a->c.threads, "board", &pool));
    cli_catch_stop();
    pvx_err e = calibrate_look(&j->look, &j->board, pool, a->c.quiet, d);
    pvx_pool_free(&pool);
    return e == PVX_OK ? calibrate_conclude(j, d) : e;
}

int calibrate_solve(int argc, char **argv)
{
    struct args a = {.c = CALIBRATE_ARGS_INIT, .to = REC_NO_FRAME};
    const struct argp_child children[] = {{calibrate_options(), 0, NULL, 0}, {0}};
    const struct argp argp = {.parser = solve_parse_opt, .doc = doc, .children = children};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct pvx_diag d = {""};
    struct calibrate_job j = {0};
    pvx_err e = solve_run(&j, &a, &d);
    calibrate_job_fini(&j);
    return cli_end(&d, e, true);
}
