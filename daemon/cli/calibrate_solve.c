/* calibrate_solve.c - `pyrovox calibrate solve`: from pictures of a board to rig.yaml. */
#include <argp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"
#include "base/yaml.h"
#include "daemon/cli/arg.h"
#include "daemon/cli/calibrate.h"
#include "daemon/cli/calibrate_look.h"
#include "daemon/cli/calibrate_report.h"
#include "daemon/cli/cli.h"
#include "daemon/cli/opt_rig.h"
#include "recon/board/spec.h"

#define MEASURED_MAX 64

struct args {
    const char *frames, *board, *out, *report, *keep, *lenses;
    const char *measured[MEASURED_MAX], *up_camera; /* NULL: the first */
    size_t n_measured;
    double volume[6], up[3];
    int32_t voxels[3]; /* 0: auto */
    int64_t floor, threads;
    bool has_volume, has_up, accept, force, quiet;
};

enum {
    OPT_FRAMES = 0x100,
    OPT_VOLUME,
    OPT_VOXELS,
    OPT_FLOOR,
    OPT_UP,
    OPT_KEEP,
    OPT_LENSES,
    OPT_MEASURED,
    OPT_REPORT,
    OPT_ACCEPT,
    OPT_FORCE,
    OPT_THREADS,
    OPT_QUIET
};

static const struct argp_option options[] = {
    {"frames", OPT_FRAMES, "DIR", 0,
     "DIR/<camera>/<number>.(png|tif|jpg|npy); pictures of one instant have one number", 0},
    {"board", 'b', "SPEC", 0, "the board as it was printed; see `pyrovox calibrate board --help`",
     0},
    {"volume", OPT_VOLUME, "X0,Y0,Z0,X1,Y1,Z1", 0,
     "the box in which the flame will burn, metres, z up", 0},
    {"out", 'o', "FILE", 0, "write the rig here", 0},
    {"voxels", OPT_VOXELS, "N|NX,NY,NZ|auto", 0,
     "voxels along x, y, z (auto, the default: the finest that the pictures hold)", 0},
    {NULL, 0, NULL, 0, "Where the world is:", 1},
    {"floor", OPT_FLOOR, "NUMBER", 0,
     "in the pictures of this number the board lies flat at the bottom of the volume: its middle "
     "is "
     "x = y = 0, its rows are x",
     1},
    {"up", OPT_UP, "X,Y,Z[,CAMERA]", 0,
     "z up, in the axes of a camera (the first): 0,-1,0 for one that stands upright and level", 1},
    {"keep", OPT_KEEP, "RIG", 0, "the world of an older rig, by the cameras that did not move", 1},
    {NULL, 0, NULL, 0, "What is known already:", 2},
    {"fix-intrinsics", OPT_LENSES, "RIG", 0, "lenses as they are in this rig, by name", 2},
    {"measured", OPT_MEASURED, "A,B,METRES", 0,
     "the distance of two cameras' lenses by tape, to check the scale; may be repeated", 2},
    {NULL, 0, NULL, 0, "What comes of it:", 3},
    {"report", OPT_REPORT, "FILE", 0,
     "everything as JSON, every picture with its reason; also where no rig can be had", 3},
    {"accept", OPT_ACCEPT, NULL, 0, "write the rig even though the report refuses it", 3},
    {"force", OPT_FORCE, NULL, 0, "write over an older FILE", 3},
    {"threads", OPT_THREADS, "N", 0, "threads to look at pictures with (0: one per CPU)", 3},
    {"quiet", OPT_QUIET, NULL, 0, "no progress", 3},
    {0}};

static const char doc[] =
    "From pictures of a calibration board to rig.yaml.\vThe five steps:\n"
    "  1. Print a board, two-sided where cameras stand all around:\n"
    "     pyrovox calibrate board charuco:8x11:0.03:0.022 --two-sided --out board.pdf\n"
    "  2. Fix cameras, focus, zoom, binning and region as they will be; short exposures.\n"
    "  3. Lay the board flat where the middle of the volume's floor is; take one picture with all "
    "cameras at the same instant: number 0.\n"
    "  4. Show the board in 30 to 100 more poses, all cameras at the same instant each time: all "
    "through the volume, tilted by up to 60 degrees each way, into the corners of every picture, "
    "and between neighbouring cameras, so that two see it together.\n"
    "  5. Solve, read the verdict, add poses where it asks for them:\n"
    "     pyrovox calibrate solve --frames pictures --board charuco:8x11:0.03:0.022:two-sided "
    "--volume -0.5,-0.5,0,0.5,0.5,1 --floor 0 --out rig.yaml\n"
    "\n"
    "How far to trust it: the expected error is that of projections all through the volume, not of "
    "the corners that were seen; tomography bears 0.10 to 0.15 voxels. single px is how well each "
    "camera agrees with itself, joint px all of them together: when the second is much larger, "
    "something moved or the cameras do not expose together.\n"
    "Exit code 1 and nothing written where the rig should not be believed; --accept overrules.";

/* Exactly n numbers with commas between; the text after them, NULL: they are not that. */
static const char *numbers(const char *s, size_t n, double *out)
{
    for (size_t i = 0; i < n; i++) {
        char item[64];
        size_t len = strcspn(s, ",");
        if (len >= sizeof item)
            return NULL;
        snprintf(item, sizeof item, "%.*s", (int)len, s);
        if (pvx_parse_double(item, -1e6, 1e6, &out[i]) != PVX_OK)
            return NULL;
        s += len;
        if (i + 1 < n && *s++ != ',')
            return NULL;
    }
    return s;
}

static void parse_volume(struct args *a, const char *arg, struct argp_state *st)
{
    const char *rest = numbers(arg, 6, a->volume);
    if (rest == NULL || *rest != '\0')
        argp_error(st, "--volume %s: should be x0,y0,z0,x1,y1,z1 in metres", arg);
    for (int i = 0; i < 3; i++)
        if (!(a->volume[3 + i] > a->volume[i]))
            argp_error(st, "--volume %s: nothing between %g and %g along %c", arg, a->volume[i],
                       a->volume[3 + i], "xyz"[i]);
    a->has_volume = true;
}

static void parse_up(struct args *a, const char *arg, struct argp_state *st)
{
    const char *rest = numbers(arg, 3, a->up);
    if (rest == NULL || (*rest != '\0' && (*rest != ',' || rest[1] == '\0')) ||
        (a->up[0] == 0 && a->up[1] == 0 && a->up[2] == 0))
        argp_error(st, "--up %s: should be x,y,z or x,y,z,CAMERA, as 0,-1,0", arg);
    else
        a->up_camera = *rest == ',' ? rest + 1 : NULL;
    a->has_up = true;
}

static void check_args(const struct args *a, struct argp_state *st)
{
    if (a->frames == NULL)
        argp_error(st, "which pictures? --frames DIR");
    if (a->board == NULL)
        argp_error(st, "which board? --board charuco:8x11:0.03:0.022");
    if (!a->has_volume)
        argp_error(st, "where will the flame burn? --volume x0,y0,z0,x1,y1,z1");
    if (a->out == NULL)
        argp_error(st, "where to? --out rig.yaml");
    if ((a->floor >= 0) + a->has_up + (a->keep != NULL) > 1)
        argp_error(st, "--floor, --up and --keep each say where the world is: give one of them");
    if (a->keep != NULL && a->lenses != NULL && strcmp(a->keep, a->lenses) != 0)
        argp_error(st, "--keep and --fix-intrinsics must name the same rig");
}

static error_t parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case OPT_FRAMES: a->frames = arg; return 0;
    case 'b': a->board = arg; return 0;
    case 'o': a->out = arg; return 0;
    case OPT_VOLUME: parse_volume(a, arg, st); return 0;
    case OPT_VOXELS:
        if (strcmp(arg, "auto") == 0)
            memset(a->voxels, 0, sizeof a->voxels);
        else if (!opt_rig_parse_grid(arg, a->voxels))
            argp_error(st, "--voxels %s: should be auto, N or NX,NY,NZ with 1 to %d voxels each",
                       arg, REC_GRID_MAX);
        return 0;
    case OPT_FLOOR: cli_arg_int(st, "floor", arg, 0, REC_NO_FRAME - 1, &a->floor); return 0;
    case OPT_UP: parse_up(a, arg, st); return 0;
    case OPT_KEEP: a->keep = arg; return 0;
    case OPT_LENSES: a->lenses = arg; return 0;
    case OPT_MEASURED:
        if (a->n_measured == MEASURED_MAX)
            argp_error(st, "--measured: at most %d", MEASURED_MAX);
        else
            a->measured[a->n_measured++] = arg;
        return 0;
    case OPT_REPORT: a->report = arg; return 0;
    case OPT_ACCEPT: a->accept = true; return 0;
    case OPT_FORCE: a->force = true; return 0;
    case OPT_THREADS: cli_arg_int(st, "threads", arg, 0, 256, &a->threads); return 0;
    case OPT_QUIET: a->quiet = true; return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': this step takes options only", arg); return 0;
    case ARGP_KEY_END: check_args(a, st); return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

/* ---- one calibration ---- */

struct job {
    const struct args *a;
    struct rec_board board;
    struct rec_rig old, rig;
    struct calibrate_look look;
    struct rec_calib_measured measured[MEASURED_MAX];
    struct rec_calib_input in;
    struct rec_calib_report report;
};

static pvx_err find_camera(const struct calibrate_look *l, const char *name, size_t len,
                           uint32_t *out, struct pvx_diag *d)
{
    for (uint32_t c = 0; c < l->n_cameras; c++)
        if (strlen(l->camera[c].name) == len && memcmp(l->camera[c].name, name, len) == 0) {
            *out = c;
            return PVX_OK;
        }
    return pvx_fail(d, PVX_ENOENT, "no pictures of a camera called '%.*s'", (int)len, name);
}

static pvx_err read_measured(struct job *j, struct pvx_diag *d)
{
    for (size_t i = 0; i < j->a->n_measured; i++) {
        struct rec_calib_measured *m = &j->measured[i];
        const char *s = j->a->measured[i], *b = strchr(s, ','),
                   *n = b != NULL ? strchr(b + 1, ',') : NULL;
        if (n == NULL || pvx_parse_double(n + 1, 1e-6, 1e6, &m->metres) != PVX_OK)
            return pvx_fail(d, PVX_EINVAL, "--measured %s: should be CAMERA,CAMERA,METRES", s);
        PVX_TRY(find_camera(&j->look, s, (size_t)(b - s), &m->a, d));
        PVX_TRY(find_camera(&j->look, b + 1, (size_t)(n - b - 1), &m->b, d));
    }
    return PVX_OK;
}

/* All that can be wrong before the pictures are looked at. */
static pvx_err prepare(struct job *j, struct pvx_diag *d)
{
    const struct args *a = j->a;
    struct rec_calib_options *o = &j->in.options;
    size_t n = a->report != NULL ? strlen(a->report) : 0;
    if (!a->force && access(a->out, F_OK) == 0)
        return pvx_fail(d, PVX_EBUSY, "%s is there already; --force writes over it", a->out);
    if (n > 0 && (n < 6 || strcmp(a->report + n - 5, ".json") != 0))
        return pvx_fail(d, PVX_EUNSUP, "%s: a report is written as .json", a->report);
    PVX_TRY(rec_board_parse(a->board, &j->board, d));
    PVX_TRY(calibrate_find(&j->look, a->frames, d));
    const char *old = a->keep != NULL ? a->keep : a->lenses;
    if (old != NULL) {
        PVX_TRY(rec_rig_load(old, &j->old, d));
        o->old = &j->old;
    }
    o->world = a->floor >= 0     ? REC_WORLD_FLOOR
               : a->has_up       ? REC_WORLD_UP
               : a->keep != NULL ? REC_WORLD_OLD
                                 : REC_WORLD_BEST;
    o->floor_frame = a->floor >= 0 ? (uint32_t)a->floor : 0;
    memcpy(o->up, a->up, sizeof o->up);
    if (a->up_camera != NULL)
        PVX_TRY(find_camera(&j->look, a->up_camera, strlen(a->up_camera), &o->up_camera, d));
    PVX_TRY(read_measured(j, d));
    o->measured = j->measured;
    o->n_measured = a->n_measured;
    for (size_t c = 0; a->lenses != NULL && c < j->look.n_cameras; c++)
        j->look.camera[c].hold = REC_HOLD_LENS;
    j->in.board = j->board;
    j->in.grid.basis = REC_BASIS_DEFAULT;
    memcpy(j->in.grid.min, a->volume, sizeof j->in.grid.min);
    memcpy(j->in.grid.max, a->volume + 3, sizeof j->in.grid.max);
    memcpy(j->in.grid.n, a->voxels, sizeof j->in.grid.n);
    return PVX_OK;
}

/* A camera that never saw the board: a reason in which something was recognised (mirrored, another board, other
 * markers), else what most of its pictures give. */
static pvx_err all_saw(const struct calibrate_look *l, struct pvx_diag *d)
{
    for (size_t c = 0; c < l->n_cameras; c++) {
        const struct calibrate_count *n = &l->count[c];
        size_t most = REC_SIGHT_NO_MARKER;
        for (size_t s = most; s < REC_N_SIGHTS; s++)
            if (n->sight[s] >
                (most < REC_SIGHT_MIRRORED && s >= REC_SIGHT_MIRRORED ? 0 : n->sight[most]))
                most = s;
        if (n->sight[REC_SIGHT_FOUND] == 0)
            return pvx_fail(
                d, PVX_EINVAL, "%s: the board is in none of %zu pictures; %zu of them: %s: %s",
                l->camera[c].name, n->pictures, n->sight[most],
                rec_sight_name((enum rec_sight)most), l->picture[n->example[most]].text);
    }
    return PVX_OK;
}

static pvx_err solve(struct job *j, struct pvx_diag *d)
{
    j->in.n_cameras = j->look.n_cameras;
    j->in.camera = j->look.camera;
    j->in.n_views = j->look.n_views;
    j->in.view = j->look.view;
    PVX_TRY(all_saw(&j->look, d));
    return rec_calib_solve(&j->in, &j->rig, &j->report, d);
}

static pvx_err write_rig(const struct job *j, struct pvx_diag *d)
{
    char *text;
    size_t len;
    PVX_TRY(rec_rig_format(&j->rig, &text, &len));
    pvx_err e = pvx_file_write(j->a->out, text, len, d);
    free(text);
    return e;
}

/* After the pictures were looked at: solved, said and written. */
static pvx_err conclude(struct job *j, struct pvx_diag *d)
{
    const struct args *a = j->a;
    struct calibrate_result r = {.board = &j->board,
                                 .grid = &j->in.grid,
                                 .look = &j->look,
                                 .report = &j->report,
                                 .accepted = a->accept};
    calibrate_print_pictures(&r);
    fflush(stdout);
    pvx_err e = solve(j, d);
    if (cli_stop)
        return PVX_ECANCELED;
    if (e == PVX_OK) {
        r.grid = &j->rig.grid;
        calibrate_print_cameras(&r);
    }
    calibrate_print_findings(&r);
    fflush(stdout);
    if (e == PVX_OK && rec_calib_says(&j->report, REC_CALIB_REFUSED, -1) && !a->accept)
        e = pvx_fail(
            d, PVX_EINVAL,
            "%s is not written, for what is refused above; --accept writes it all the same",
            a->out);
    pvx_err written = a->report != NULL ? calibrate_write_json(&r, a->report, d) : PVX_OK;
    if (e == PVX_OK)
        e = written;
    if (e == PVX_OK)
        e = write_rig(j, d);
    if (e == PVX_OK)
        printf("%s: %zu cameras, %d x %d x %d voxels\n", a->out, j->rig.n_cameras, j->rig.grid.n[0],
               j->rig.grid.n[1], j->rig.grid.n[2]);
    return e;
}

static pvx_err run(struct job *j, struct pvx_diag *d)
{
    pvx_pool *pool;
    PVX_TRY(prepare(j, d));
    PVX_TRY(pvx_pool_new((unsigned)j->a->threads, "board", &pool));
    cli_catch_stop();
    pvx_err e = calibrate_look(&j->look, &j->board, pool, j->a->quiet, d);
    pvx_pool_free(&pool);
    return e == PVX_OK ? conclude(j, d) : e;
}

int calibrate_solve(int argc, char **argv)
{
    struct args a = {.floor = -1};
    const struct argp argp = {.options = options, .parser = parse_opt, .doc = doc};
    if (argp_parse(&argp, argc, argv, 0, NULL, &a) != 0)
        return 2;
    struct pvx_diag d = {""};
    struct job j = {.a = &a};
    pvx_err e = run(&j, &d);
    calibrate_look_fini(&j.look);
    rec_calib_report_fini(&j.report);
    rec_rig_fini(&j.rig);
    rec_rig_fini(&j.old);
    if (e == PVX_ECANCELED) {
        fprintf(stderr, "\npyrovox: stopped; nothing was written\n");
        return 130;
    }
    return e == PVX_OK ? 0 : cli_error(&d, e);
}
