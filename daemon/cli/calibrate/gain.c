/* gain.c - `pyrovox calibrate gain`: how bright cameras are beside each other. */
#include <stdio.h>
#include <string.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/gain.h"

static const char gain_doc[] =
    "Compare the brightness of the cameras, through the filters in use, and write gains into "
    "rig.yaml.\v"
    "By one even source that fills the middle of every picture:\n"
    "  pyrovox calibrate gain --rig rig3.yaml --frames source.h5 --out rig4.yaml\n"
    "\nOr by many pictures of a flame, whose light all cameras see alike:\n"
    "  pyrovox calibrate gain --rig rig3.yaml --flame --frames flame.h5 \\\n"
    "          --out rig4.yaml\n"
    "\n"
    "Do this after dark and flat. The product of the gains of each colour is 1.\n"
    "By a flame: first the integrated emission is compared, for cameras that see all of the flame. "
    "Then each camera is compared with the volume that the others make, alternately with the "
    "reconstruction, on two thirds of the frame sets. The second result is used if views that were "
    "left out agree no worse in the last third. Otherwise the first is used, and a line says so. A "
    "camera that sees only a part of the flame needs three others and a rig whose poses are right. "
    "A flame that hides itself is no measure.";

struct gain_args {
    struct calibrate_light_args light;
    struct calibrate_gain by;
    bool flame;
};
static struct gain_args args; /* this program runs one step */

/* Light of camera c in each colour; 0: it has no pictures. */
static pvx_err gain_light_of(const struct calibrate_light *l, size_t c, size_t g, double out[3],
                             struct pvx_diag *d)
{
    const struct rec_light_picture *p = &calibrate_light_stack(l, g, c)->picture;
    const struct rec_camera *k = &l->rig.cameras[c];
    memset(out, 0, 3 * sizeof *out);
    if (p->n == 0)
        return PVX_OK;
    if (p->saturated > 0.001)
        return pvx_fail(d, PVX_EINVAL,
                        "camera %s: %s is saturated in %.1f %% of its samples: expose less",
                        k->name, l->a->frames[g], 100 * p->saturated);
    rec_light_middle(p, out);
    for (int a = 0; a < 3; a++)
        if (!(out[a] > 0.02))
            return pvx_fail(
                d, PVX_EINVAL,
                "camera %s: %s is dark in the middle (%.3f of full scale): the source must "
                "be there, brighter",
                k->name, l->a->frames[g], out[a]);
    return PVX_OK;
}

static pvx_err by_source(struct calibrate_light *l, struct pvx_diag *d)
{
    static double sum[3][REC_MAX_CAMERAS];
    size_t n = l->rig.n_cameras;
    for (size_t g = 0; g < l->a->n; g++)
        for (size_t c = 0; c < n; c++) {
            double v[3];
            PVX_TRY(gain_light_of(l, c, g, v, d));
            for (int a = 0; a < 3; a++)
                sum[a][c] += v[a];
        }
    for (int a = 0; a < 3; a++) {
        double gain[REC_MAX_CAMERAS];
        rec_light_gains(sum[a], n, gain);
        for (size_t c = 0; c < n; c++)
            l->rig.cameras[c].gain[a] = (float)gain[c];
    }
    return PVX_OK;
}

static pvx_err gain_step(struct calibrate_light *l, struct pvx_diag *d)
{
    size_t with = 0;
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        bool any = false;
        for (size_t g = 0; g < l->a->n; g++)
            any |= calibrate_light_stack(l, g, c)->picture.n > 0;
        with += any;
    }
    if (with < 2)
        return pvx_fail(d, PVX_EINVAL, "%zu cameras have pictures: gains are between two or more",
                        with);
    PVX_TRY(args.flame ? calibrate_gain_flame(l, &args.by, d) : by_source(l, d));
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        printf("%-12s gain %.4f %.4f %.4f\n", l->rig.cameras[c].name,
               (double)l->rig.cameras[c].gain[0], (double)l->rig.cameras[c].gain[1],
               (double)l->rig.cameras[c].gain[2]);
    return calibrate_light_save(l, d);
}

enum { OPT_SETS = 0xa00, OPT_REPORT, OPT_QUIET };

static error_t gain_parse(int key, char *arg, struct argp_state *st)
{
    struct gain_args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &a->light; return 0;
    case 'f': a->flame = true; return 0;
    case OPT_SETS: cli_arg_int(st, "sets", arg, REC_GAINS_SETS, 1000, &a->by.sets); return 0;
    case OPT_REPORT: a->by.report = arg; return 0;
    case OPT_QUIET: a->by.quiet = true; return 0;
    case ARGP_KEY_END:
        if (a->by.report != NULL && !a->flame)
            argp_error(st, "--report belongs to --flame");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

int calibrate_gain(int argc, char **argv)
{
    static const struct argp_option options[] = {
        {"flame", 'f', NULL, 0, "the pictures are of a flame, not of an even source", 0},
        {"sets", OPT_SETS, "N", 0,
         "with --flame: reconstruct N frame sets, spread over the pictures (default 30)", 0},
        {"report", OPT_REPORT, "FILE.json", 0, "with --flame: all figures", 0},
        {"quiet", OPT_QUIET, NULL, 0, "no progress", 0},
        {0}};
    const struct argp_child children[] = {{&calibrate_light_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {
        .options = options, .parser = gain_parse, .doc = gain_doc, .children = children};
    args = (struct gain_args){.by = {.sets = 30}};
    if (argp_parse(&argp, argc, argv, 0, NULL, &args) != 0)
        return 2;
    return calibrate_light_run(&args.light, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK | DMN_LIGHT_FLAT,
                               gain_step);
}
