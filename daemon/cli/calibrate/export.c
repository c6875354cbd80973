/* export.c - `pyrovox calibrate export`: a rig's cameras for other programs. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "recon/exchange/exchange.h"

struct args {
    const char *rig, *cameras, *to, *out;
    bool force;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"rig", "FILE", AT(rig), 0, 0, "rig.yaml"},
    {"to", "FORMAT", AT(to), 0, 0,
     "opencv (FileStorage), ros (a camera_info for each camera), kalibr (camchain), colmap (text), "
     "anipose (also aniposelib, caliscope), jarvis, or blender (for Pyrovox's add-on)"},
    {"o|out", "PATH", AT(out), 0, 0, "write it here; a folder for ros, colmap and jarvis"},
    {"cameras", "A,B,...", AT(cameras), 0, 0, "these cameras only"},
    {"force", NULL, AT(force), 0, 0, "write over an older PATH"},
    {0}};

static const char doc[] =
    "Write the cameras of a rig for another program.\vExamples:\n"
    "  pyrovox calibrate export --rig rig.yaml --to opencv --out cameras.yml\n"
    "  pyrovox calibrate export --rig rig.yaml --to colmap --out sparse\n"
    "\n"
    "Lenses and poses are converted to the conventions of the format. Lengths stay metres, but "
    "for jarvis, which has millimetres. The volume, gains, photometry, blur, bodies and "
    "uncertainties "
    "are not written. A lens that the format cannot hold is refused.";

static error_t export_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_ARG: argp_error(st, "'%s': this step takes options only", arg); return 0;
    case ARGP_KEY_END:
        if (a->rig == NULL)
            argp_error(st, "which rig? --rig rig.yaml");
        if (a->to == NULL)
            argp_error(st, "for which program? --to opencv");
        if (a->out == NULL)
            argp_error(st, "where to? --out PATH");
        if (a->to != NULL && rec_exchange_by_name(a->to) == REC_EXCHANGE_FORMATS)
            argp_error(st,
                       "--to %s: should be opencv, ros, kalibr, colmap, anipose, jarvis or "
                       "blender",
                       a->to);
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

/* How far distortion moves a corner of the picture, at most, px. */
static double export_distortion(const struct rec_camera *c)
{
    double worst = 0;
    for (int i = 0; i < 4; i++) {
        const double u = i & 1 ? c->width - 0.5 : -0.5, v = i & 2 ? c->height - 0.5 : -0.5;
        double at[3], ray[3], to[3];
        if (!rec_camera_ray(c, u, v, at, ray))
            continue;
        for (int k = 0; k < 3; k++)
            to[k] = c->R[3 * k] * ray[0] + c->R[3 * k + 1] * ray[1] + c->R[3 * k + 2] * ray[2];
        worst = fmax(worst,
                     hypot(c->fx * to[0] / to[2] + c->cx - u, c->fy * to[1] / to[2] + c->cy - v));
    }
    return worst;
}

/* What the format leaves out. */
static void export_say(const struct rec_rig *r, enum rec_exchange_format to)
{
    double worst = 0;
    bool light = r->bodies.n > 0;
    for (size_t i = 0; i < r->n_cameras; i++) {
        const struct rec_camera *c = &r->cameras[i];
        worst = fmax(worst, export_distortion(c));
        light = light || c->gain[0] != 1 || c->gain[1] != 1 || c->gain[2] != 1 ||
                rec_photometry_acts(&c->photometry) || c->blur.sigma != 0 || c->blur.aperture != 0;
    }
    if (to == REC_EXCHANGE_BLENDER && worst > 0.01)
        printf("Blender has no lens distortion: up to %.1f px in the pictures' corners are left "
               "out\n",
               worst);
    if (to == REC_EXCHANGE_ROS)
        printf("camera_info has no poses: they are left out\n");
    if (light)
        printf("the rig's gains, photometry, blur and bodies are left out\n");
}

static pvx_err export_run(const struct args *a, struct pvx_diag *d)
{
    const enum rec_exchange_format to = rec_exchange_by_name(a->to);
    struct rec_rig rig;
    PVX_TRY(cli_may_write(a->out, a->force, d));
    PVX_TRY(rec_rig_load(a->rig, &rig, d));
    pvx_err e = a->cameras != NULL ? rec_rig_select(&rig, a->cameras, d) : PVX_OK;
    PVX_THEN(e, rec_exchange_write(&rig, to, a->out, d));
    if (e == PVX_OK) {
        export_say(&rig, to);
        printf("%s: %zu cameras for %s\n", a->out, rig.n_cameras, a->to);
    }
    rec_rig_fini(&rig);
    return e;
}

int calibrate_export(int argc, char **argv)
{
    struct args a = {0};
    const struct argp argp = {.parser = export_parse_opt, .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct pvx_diag d = {""};
    pvx_err e = export_run(&a, &d);
    return e == PVX_OK ? 0 : cli_end(&d, e, true);
}
