/* import.c - `pyrovox calibrate import`: calibrations of other programs to rig.yaml. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "base/yaml.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/options.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/exchange/exchange.h"
#include "recon/geom/blind.h"

#define MAX_FILES (2 * REC_MAX_CAMERAS)
enum { OPT_FROM = 0x900, OPT_UNIT, OPT_VOLUME, OPT_VOXELS, OPT_SIZE, OPT_UP, OPT_CENTRE };

struct import_size {
    const char *camera; /* "" for all; ends in '=' */
    int32_t w, h;
};

struct args {
    const char *file[MAX_FILES], *out;
    size_t n, n_sizes;
    enum rec_exchange_format from;
    double unit, volume[6], centre;
    int32_t voxels[3];
    struct import_size size[REC_MAX_CAMERAS];
    int up; /* place in up_words */
    bool has_volume, centred, accept, force;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"o|out", "RIG", AT(out), 0, 0, "write the rig here"},
    {"volume", "X0,Y0,Z0,X1,Y1,Z1", CLI_KEY(OPT_VOLUME), 0, 0,
     "the box in which the flame burns, metres, in the axes of the rig"},
    {"unit", "mm|cm|m|inch|METRES", CLI_KEY(OPT_UNIT), 0, 0,
     "unit of the files' lengths, where they do not say it; a number: metres per unit"},
    {"size", "[CAMERA=]WxH", CLI_KEY(OPT_SIZE), 0, 0,
     "size of the pictures in pixels, where the files do not say it; may be repeated"},
    {"from", "FORMAT", CLI_KEY(OPT_FROM), 0, 0,
     "opencv, ros, kalibr, colmap, anipose (caliscope, too), matlab, jarvis, agisoft or blender; "
     "default: by content"},
    {"up", "x|-x|y|-y|z|-z", CLI_KEY(OPT_UP), 0, 0,
     "which axis of the files points up; it becomes z of the rig (default z: nothing is turned)"},
    {"pixel-centre", "N", CLI_KEY(OPT_CENTRE), 0, 0,
     "where the files have the centre of the first pixel, if not where their format has it: 0, 0.5 "
     "or 1"},
    {"voxels", "N|NX,NY,NZ|auto", CLI_KEY(OPT_VOXELS), 0, 0,
     "voxels along x, y, z (auto, the default: the finest that the pictures hold)"},
    {"accept", NULL, AT(accept), 0, 0, "write the rig even though cameras do not see the volume"},
    {"force", NULL, AT(force), 0, 0, "write over an older RIG"},
    {0}};

static const char doc[] =
    "Make a rig.yaml of a calibration of another program.\vExamples:\n"
    "  pyrovox calibrate import intrinsics.yml extrinsics.yml \\\n"
    "          --size 640x480 --unit m --volume -0.2,-0.2,0.5,0.2,0.2,0.9 \\\n"
    "          --out rig.yaml\n"
    "  pyrovox calibrate import sparse/0 --unit 0.137 --up -y \\\n"
    "          --volume -0.5,-0.5,0,0.5,0.5,1 --out rig.yaml\n"
    "\n"
    "FILE is a file of OpenCV's FileStorage (YAML, XML, JSON), a ROS camera_info, a camchain of "
    "Kalibr, a folder of COLMAP (text or binary), a TOML of anipose, aniposelib or caliscope, "
    "MATLAB's stereoParameters (toStruct, saved with -v7.3), a file of JARVIS, cameras of Agisoft "
    "Metashape (XML), or cameras that Pyrovox's add-on exported from Blender.\n"
    "A camera may have its lens in one FILE and its pose in another, under one name. A file of "
    "poses alone, in YAML, JSON or XML, has for each camera: R (9 numbers, or a rotation vector "
    "of 3) and T (3 numbers), from the world to the camera.\n"
    "\n"
    "What the files do not say is asked for: the unit, the sizes, the volume. A table shows "
    "the cameras. If the volume is not in sight, nothing is written, and the message says "
    "what was probably meant. `man pyrovox-calibrate` has the conventions of each format.";

static const char up_words[] = "x|-x|y|-y|z|-z";
/* Rows: axes of the rig in those of the files. */
static const double up_turns[6][9] = {{0, 1, 0, 0, 0, 1, 1, 0, 0},  {0, 1, 0, 0, 0, -1, -1, 0, 0},
                                      {1, 0, 0, 0, 0, -1, 0, 1, 0}, {1, 0, 0, 0, 0, 1, 0, -1, 0},
                                      {1, 0, 0, 0, 1, 0, 0, 0, 1},  {1, 0, 0, 0, -1, 0, 0, 0, -1}};

static void import_parse_unit(struct args *a, const char *arg, struct argp_state *st)
{
    static const struct {
        const char *name;
        double metres;
    } units[] = {{"mm", 1e-3}, {"cm", 1e-2}, {"m", 1}, {"inch", 0.0254}};
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcmp(arg, units[i].name) == 0) {
            a->unit = units[i].metres;
            return;
        }
    if (pvx_parse_double(arg, 1e-9, 1e9, &a->unit) != PVX_OK)
        argp_error(st, "--unit %s: should be mm, cm, m, inch, or metres per unit", arg);
}

static void import_parse_size(struct args *a, const char *arg, struct argp_state *st)
{
    const char *equals = strrchr(arg, '=');
    if (a->n_sizes == REC_MAX_CAMERAS)
        argp_error(st, "--size: at most %d", REC_MAX_CAMERAS);
    struct import_size *s = &a->size[a->n_sizes++];
    s->camera = equals != NULL ? arg : "";
    cli_arg_size(st, "size", equals != NULL ? equals + 1 : arg, 1, 16384, &s->w, &s->h);
}

static void import_parse_from(struct args *a, const char *arg, struct argp_state *st)
{
    a->from = rec_exchange_by_name(arg);
    if (a->from == REC_EXCHANGE_FORMATS)
        argp_error(st,
                   "--from %s: should be opencv, ros, kalibr, colmap, anipose, matlab, jarvis, "
                   "agisoft or blender",
                   arg);
}

static error_t import_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case OPT_FROM: import_parse_from(a, arg, st); return 0;
    case OPT_UNIT: import_parse_unit(a, arg, st); return 0;
    case OPT_VOLUME:
        calibrate_parse_volume(st, arg, a->volume);
        a->has_volume = true;
        return 0;
    case OPT_SIZE: import_parse_size(a, arg, st); return 0;
    case OPT_UP: a->up = cli_arg_word(st, "up", arg, up_words); return 0;
    case OPT_CENTRE:
        a->centre = cli_arg_double(st, "pixel-centre", arg, 0, 1);
        a->centred = true;
        return 0;
    case OPT_VOXELS: calibrate_parse_voxels(st, arg, a->voxels); return 0;
    case ARGP_KEY_ARG:
        if (a->n == MAX_FILES)
            argp_error(st, "at most %d files", MAX_FILES);
        a->file[a->n++] = arg;
        return 0;
    case ARGP_KEY_END:
        if (a->n == 0)
            argp_error(st, "which calibration? pyrovox calibrate import FILE... --out rig.yaml");
        if (a->out == NULL)
            argp_error(st, "where to? --out rig.yaml");
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static bool import_is_size_of(const struct import_size *s, const char *name)
{
    size_t n = strlen(name);
    return *s->camera == '\0' || (strncmp(s->camera, name, n) == 0 && s->camera[n] == '=');
}

/* A size of the command line.  One for all cameras does not concern those that were named before. */
static pvx_err import_size_of(const struct import_size *s, struct rec_exchange *x,
                              bool given[REC_MAX_CAMERAS], struct pvx_diag *d)
{
    const bool named = *s->camera != '\0';
    bool used = false;
    for (size_t k = 0; k < x->n; k++) {
        struct rec_camera *c = &x->camera[k].c;
        if (!import_is_size_of(s, c->name))
            continue;
        used = true;
        if (given[k] && !named)
            continue;
        if (c->width != 0 && (c->width != s->w || c->height != s->h))
            return pvx_fail(d, PVX_EINVAL,
                            "camera '%s' has pictures of %dx%d%s, and --size says %dx%d: K belongs "
                            "to one size",
                            c->name, c->width, c->height, given[k] ? "" : " in its file", s->w,
                            s->h);
        c->width = s->w;
        c->height = s->h;
        given[k] = true;
    }
    return used ? PVX_OK : pvx_fail(d, PVX_ENOENT, "--size %s: no camera has this name", s->camera);
}

static pvx_err import_sizes(const struct args *a, struct rec_exchange *x, struct pvx_diag *d)
{
    bool given[REC_MAX_CAMERAS] = {false};
    for (int named = 1; named >= 0; named--)
        for (size_t i = 0; i < a->n_sizes; i++)
            if ((*a->size[i].camera != '\0') == named)
                PVX_TRY(import_size_of(&a->size[i], x, given, d));
    return PVX_OK;
}

/* Lens, pose and size of every camera, and the unit. */
static pvx_err import_complete(const struct args *a, struct rec_exchange *x, struct pvx_diag *d)
{
    for (size_t i = 0; i < x->n; i++) {
        const struct rec_exchange_camera *c = &x->camera[i];
        if (!c->lens)
            return pvx_fail(d, PVX_EINVAL,
                            "camera '%s' has a pose but no lens: give the file with its K, too, "
                            "under the same name",
                            c->c.name);
        if (!c->pose)
            return pvx_fail(d, PVX_EINVAL,
                            "camera '%s' has a lens but no pose: give a second file with R and T "
                            "from the world to the camera, as \"%s: {R: [9 numbers], T: [3 "
                            "numbers]}\"",
                            c->c.name, c->c.name);
        if (c->c.width == 0)
            return pvx_fail(d, PVX_EINVAL,
                            "camera '%s': how large are its pictures? --size %s=WIDTHxHEIGHT",
                            c->c.name, c->c.name);
    }
    if (x->unit == 0 && a->unit == 0)
        return pvx_fail(d, PVX_EINVAL,
                        "in which unit are the files' lengths? --unit mm, cm, m, inch, or metres "
                        "per unit (%s)",
                        x->seen & 1u << REC_EXCHANGE_COLMAP || x->seen & 1u << REC_EXCHANGE_AGISOFT
                            ? "a model from pictures alone has no unit: measure a distance of two "
                              "cameras"
                            : "it is that of the board's squares");
    if (x->unit != 0 && a->unit != 0 && fabs(x->unit / a->unit - 1) > 1e-9)
        return pvx_fail(d, PVX_EINVAL,
                        "the files say that their unit is %g m, and --unit says %g m: leave out "
                        "--unit",
                        x->unit, a->unit);
    return PVX_OK;
}

/* Metres, and z up. */
static void import_to_world(const struct args *a, struct rec_exchange *x)
{
    const double unit = x->unit != 0 ? x->unit : a->unit, *turn = up_turns[a->up];
    for (size_t i = 0; i < x->n; i++) {
        struct rec_camera *c = &x->camera[i].c;
        double R[9] = {0};
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++)
                for (int j = 0; j < 3; j++)
                    R[3 * r + k] += c->R[3 * r + j] * turn[3 * k + j];
        memcpy(c->R, R, sizeof R);
        for (int k = 0; k < 3; k++)
            c->t[k] *= unit;
    }
}

static void import_show(const struct rec_exchange *x)
{
    double at[3];
    printf("%-16s %11s  %26s  %20s  %11s  lens\n", "camera", "pictures", "place (m)", "looks along",
           "view (deg)");
    for (size_t i = 0; i < x->n; i++) {
        const struct rec_camera *c = &x->camera[i].c;
        char size[24], view[24];
        int used = 0;
        rec_camera_centre(c, at);
        snprintf(size, sizeof size, "%dx%d", c->width, c->height);
        snprintf(view, sizeof view, "%.0f x %.0f", 360 / M_PI * atan(c->width / (2 * c->fx)),
                 360 / M_PI * atan(c->height / (2 * c->fy)));
        for (int k = 0; k < 8; k++)
            used += c->dist[k] != 0;
        printf("%-16s %11s  %8.3f %8.3f %8.3f  %6.2f %6.2f %6.2f  %11s  %s%s\n", c->name, size,
               at[0], at[1], at[2], c->R[6], c->R[7], c->R[8], c->model == REC_FISHEYE ? "" : view,
               c->model == REC_FISHEYE ? "fisheye" : "pinhole", used > 0 ? "" : ", no distortion");
    }
    if (x->n > 1 && rec_exchange_aim(x, at))
        printf("the cameras' axes pass nearest to %.3f, %.3f, %.3f\n", at[0], at[1], at[2]);
    if (x->note[0] != '\0')
        printf("%s\n", x->note);
    fflush(stdout);
}

static pvx_err import_rig(const struct args *a, const struct rec_exchange *x, struct pvx_diag *d)
{
    struct rec_camera *cameras = pvx_calloc(x->n, sizeof *cameras);
    struct rec_rig rig = {.n_cameras = x->n, .cameras = cameras}, back;
    char why[PVX_DIAG_MAX - 200], *text = NULL;
    size_t len;
    PVX_NEED(cameras);
    for (size_t i = 0; i < x->n; i++)
        cameras[i] = x->camera[i].c;
    memcpy(rig.grid.min, a->volume, sizeof rig.grid.min);
    memcpy(rig.grid.max, a->volume + 3, sizeof rig.grid.max);
    memcpy(rig.grid.n, a->voxels, sizeof rig.grid.n);
    rig.grid.basis = REC_BASIS_DEFAULT;
    pvx_err e = PVX_OK;
    if (rec_rig_blind(&rig, why, sizeof why) != REC_BLIND_NONE && !a->accept)
        e = pvx_fail(d, PVX_EINVAL,
                     "%s; or a unit of the files is not %g m, or --volume is not in the axes of "
                     "the table (--accept: write the rig all the same)",
                     why, x->unit != 0 ? x->unit : a->unit);
    if (e == PVX_OK && rig.grid.n[0] == 0 && rec_rig_finest(&rig, 1, rig.grid.n) != PVX_OK)
        e = pvx_fail(d, PVX_EINVAL,
                     "no camera has the middle of the volume in front of it: give --voxels");
    PVX_THEN(e, rec_rig_format(&rig, &text, &len));
    PVX_THEN(e, rec_rig_parse(text, len, a->out, &back, d)); /* whatever else a rig refuses */
    if (e == PVX_OK) {
        e = opt_rig_save(&back, NULL, a->out, d);
        rec_rig_fini(&back);
    }
    free(text);
    free(cameras);
    return e;
}

static pvx_err import_run(const struct args *a, struct rec_exchange *x, struct pvx_diag *d)
{
    PVX_TRY(cli_may_write(a->out, a->force, d));
    x->centre = a->centre;
    x->centred = a->centred;
    for (size_t i = 0; i < a->n; i++)
        PVX_TRY(rec_exchange_read(a->file[i], a->from, x, d));
    PVX_TRY(rec_exchange_end(x, d));
    PVX_TRY(import_sizes(a, x, d));
    PVX_TRY(import_complete(a, x, d));
    import_to_world(a, x);
    import_show(x);
    if (!a->has_volume)
        return pvx_fail(d, PVX_EINVAL,
                        "where will the flame burn? --volume x0,y0,z0,x1,y1,z1, metres, in the "
                        "axes of this table");
    PVX_TRY(import_rig(a, x, d));
    printf("%s: %zu cameras\n", a->out, x->n);
    return PVX_OK;
}

int calibrate_import(int argc, char **argv)
{
    static struct rec_exchange x; /* large */
    static struct args a;
    const struct argp argp = {.parser = import_parse_opt, .args_doc = "FILE...", .doc = doc};
    a.up = 4;
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct pvx_diag d = {""};
    pvx_err e = import_run(&a, &x, &d);
    return e == PVX_OK ? 0 : cli_end(&d, e, true);
}
