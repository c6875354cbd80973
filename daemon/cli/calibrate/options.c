#include "daemon/cli/calibrate/options.h"

#include <stdio.h>
#include <string.h>

#include "base/yaml.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/calib/calib.h"

enum { OPT_VOLUME = 0x800, OPT_VOXELS, OPT_UP, OPT_ADD, OPT_RECOVER, OPT_MEASURED, OPT_REPORT };

#define AT(field) CLI_AT(struct calibrate_args, field)

static const struct cli_row rows[] = {
    {"b|board", "SPEC", AT(board), 0, 0,
     "the board as it was printed; see `pyrovox calibrate board --help`"},
    {"volume", "X0,Y0,Z0,X1,Y1,Z1", CLI_KEY(OPT_VOLUME), 0, 0,
     "the box in which the flame will burn, metres, z up"},
    {"o|out", "FILE", AT(out), 0, 0, "write the rig here"},
    {"voxels", "N|NX,NY,NZ|auto", CLI_KEY(OPT_VOXELS), 0, 0,
     "voxels along x, y, z (auto, the default: the finest that the pictures hold)"},
    {.help = "World:"},
    {"floor", "NUMBER", AT(floor), 0, REC_NO_FRAME - 1,
     "in the pictures of this number the board lies flat at the bottom of the volume: its middle "
     "is x = y = 0, its rows are x"},
    {"up", "X,Y,Z[,CAMERA]", CLI_KEY(OPT_UP), 0, 0,
     "z up, in the axes of a camera (the first): 0,-1,0 for one that stands upright and level"},
    {"keep", "RIG", AT(keep), 0, 0, "the world of an older rig, by the cameras that did not move"},
    {.help = "Known already:"},
    {"fix-intrinsics", "RIG", AT(lenses), 0, 0, "lenses as they are in this rig, by name"},
    {"add", "CAMERA", CLI_KEY(OPT_ADD), 0, 0,
     "a new camera: all others stay as they are in the rig of --keep, to which it is added; may be "
     "repeated"},
    {"recover", "CAMERA", CLI_KEY(OPT_RECOVER), 0, 0,
     "a camera that was moved: it keeps its lens, all others stay as they are in the rig of "
     "--keep; may be repeated"},
    {"measured", "A,B,METRES", CLI_KEY(OPT_MEASURED), 0, 0,
     "the distance of two cameras' lenses by tape, to check the scale; may be repeated"},
    {.help = "Output:"},
    {"report", "FILE", CLI_KEY(OPT_REPORT), 0, 0,
     "a page to look at (FILE.html) or everything as JSON (FILE.json), every picture with its "
     "reason; also where no rig can be had; may be given twice"},
    {"accept", NULL, AT(accept), 0, 0, "write the rig even though the report refuses it"},
    {"force", NULL, AT(force), 0, 0, "write over an older FILE"},
    {"threads", "N", AT(threads), 0, 256, "threads to look at pictures with (0: one per CPU)"},
    {"quiet", NULL, AT(quiet), 0, 0, "no progress"},
    {0}};

const char *calibrate_parse_numbers(const char *s, size_t n, double *out)
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
        if (*s == ',' ? *++s == '\0' : i + 1 < n)
            return NULL;
    }
    return s;
}

void calibrate_parse_volume(struct argp_state *st, const char *arg, double volume[6])
{
    const char *rest = calibrate_parse_numbers(arg, 6, volume);
    if (rest == NULL || *rest != '\0')
        argp_error(st, "--volume %s: should be x0,y0,z0,x1,y1,z1 in metres", arg);
    for (int i = 0; i < 3; i++)
        if (!(volume[3 + i] > volume[i]))
            argp_error(st, "--volume %s: nothing between %g and %g along %c", arg, volume[i],
                       volume[3 + i], "xyz"[i]);
}

void calibrate_parse_voxels(struct argp_state *st, const char *arg, int32_t voxels[3])
{
    if (strcmp(arg, "auto") == 0)
        memset(voxels, 0, 3 * sizeof *voxels);
    else if (!opt_rig_parse_grid(arg, voxels))
        argp_error(st, "--voxels %s: should be auto, N or NX,NY,NZ with 1 to %d voxels each", arg,
                   REC_GRID_MAX);
}

static void parse_up(struct calibrate_args *a, const char *arg, struct argp_state *st)
{
    const char *name = calibrate_parse_numbers(arg, 3, a->up);
    if (name == NULL || (a->up[0] == 0 && a->up[1] == 0 && a->up[2] == 0))
        argp_error(st, "--up %s: should be x,y,z or x,y,z,CAMERA, as 0,-1,0", arg);
    a->up_camera = name != NULL && *name != '\0' ? name : NULL;
    a->has_up = true;
}

static void parse_name(struct calibrate_names *o, const char *arg, struct argp_state *st)
{
    if (o->n == REC_MAX_CAMERAS)
        argp_error(st, "%s: more than %d cameras", arg, REC_MAX_CAMERAS);
    else
        o->name[o->n++] = arg;
}

static void calibrate_options_check(const struct calibrate_args *a, struct argp_state *st)
{
    if (a->board == NULL)
        argp_error(st, "which board? --board charuco:8x11:0.03:0.022");
    bool one = a->add.n + a->recover.n > 0;
    if (one && a->keep == NULL)
        argp_error(st, "--add and --recover: to which rig? --keep rig.yaml");
    if (one && (a->has_volume || a->voxels[0] > 0 || a->lenses != NULL))
        argp_error(st, "--add and --recover take volume, voxels and lenses from the rig of --keep: "
                       "leave out --volume, --voxels and --fix-intrinsics");
    if (!a->has_volume && !a->volume_later && !one)
        argp_error(st, "where will the flame burn? --volume x0,y0,z0,x1,y1,z1");
    if (a->out == NULL)
        argp_error(st, "where to? --out rig.yaml");
    if ((a->floor >= 0) + a->has_up + (a->keep != NULL) > 1)
        argp_error(st, "--floor, --up and --keep each say where the world is: give one of them");
    if (a->keep != NULL && a->lenses != NULL && strcmp(a->keep, a->lenses) != 0)
        argp_error(st, "--keep and --fix-intrinsics must name the same rig");
}

static error_t calibrate_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct calibrate_args *a = st->input;
    switch (key) {
    case OPT_VOLUME:
        calibrate_parse_volume(st, arg, a->volume);
        a->has_volume = true;
        return 0;
    case OPT_VOXELS: calibrate_parse_voxels(st, arg, a->voxels); return 0;
    case OPT_UP: parse_up(a, arg, st); return 0;
    case OPT_ADD: parse_name(&a->add, arg, st); return 0;
    case OPT_RECOVER: parse_name(&a->recover, arg, st); return 0;
    case OPT_MEASURED:
        if (a->n_measured == CALIBRATE_MEASURED)
            argp_error(st, "--measured: at most %d", CALIBRATE_MEASURED);
        else
            a->measured[a->n_measured++] = arg;
        return 0;
    case OPT_REPORT:
        if (a->n_reports == CALIBRATE_REPORTS)
            argp_error(st, "--report: at most %d, one .html and one .json", CALIBRATE_REPORTS);
        else
            a->report[a->n_reports++] = arg;
        return 0;
    case ARGP_KEY_END: calibrate_options_check(a, st); return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

const struct argp *calibrate_options(void)
{
    static struct argp_option options[sizeof rows / sizeof *rows];
    static struct argp argp = {.parser = calibrate_parse_opt};
    argp.options = cli_rows(rows, options);
    return &argp;
}
