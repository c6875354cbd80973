/* calibrate_gain.c - `pyrovox calibrate gain`: how bright cameras are beside each other. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cli/calibrate.h"
#include "daemon/cli/calibrate_light.h"

static const char gain_doc[] =
    "How bright the cameras are beside each other, through the filters in use, into rig.yaml.\v"
    "By one even source that fills the middle of every picture:\n"
    "  pyrovox calibrate gain --rig rig3.yaml --frames source.h5 --out rig4.yaml\n"
    "or by a flame that is wholly in every picture, whose light all cameras see alike:\n"
    "  pyrovox calibrate gain --rig rig3.yaml --flame --frames flame.h5 --out rig4.yaml\n"
    "After dark and flat. The product of the gains of each colour is 1. A flame that hides itself, "
    "or "
    "one of few pictures, is no measure.";

struct gain_args {
    struct calibrate_light_args light;
    bool flame;
};
static bool by_flame; /* this program runs one step */

/* Light of camera c in each colour, over all groups; 0: it has no pictures. */
static pvx_err light_of(const struct calibrate_light *l, size_t c, size_t g, const double at[3],
                        double out[3], struct pvx_diag *d)
{
    const struct rec_light_picture *p = &calibrate_light_stack(l, g, c)->picture;
    const struct rec_camera *k = &l->rig.cameras[c];
    struct pvx_diag why = {""};
    memset(out, 0, 3 * sizeof *out);
    if (p->n == 0)
        return PVX_OK;
    if (by_flame) {
        pvx_err e = rec_light_flux(p, k, at, out, &why);
        return e == PVX_OK ? e : calibrate_light_fail(k, e, &why, d);
    }
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

static pvx_err where(const struct calibrate_light *l, size_t g, double at[3], struct pvx_diag *d)
{
    const struct rec_light_picture *p[REC_MAX_CAMERAS];
    struct rec_camera cam[REC_MAX_CAMERAS];
    size_t n = 0;
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        if (calibrate_light_stack(l, g, c)->picture.n > 0) {
            p[n] = &calibrate_light_stack(l, g, c)->picture;
            cam[n++] = l->rig.cameras[c];
        }
    return rec_light_where(p, cam, n, at, d);
}

static pvx_err gain_step(struct calibrate_light *l, struct pvx_diag *d)
{
    static double sum[3][REC_MAX_CAMERAS];
    size_t n = l->rig.n_cameras;
    for (size_t g = 0; g < l->a->n; g++) {
        double at[3] = {0};
        if (by_flame)
            PVX_TRY(where(l, g, at, d));
        for (size_t c = 0; c < n; c++) {
            double v[3];
            PVX_TRY(light_of(l, c, g, at, v, d));
            for (int a = 0; a < 3; a++)
                sum[a][c] += v[a];
        }
    }
    size_t with = 0;
    for (size_t c = 0; c < n; c++)
        with += sum[1][c] > 0;
    if (with < 2)
        return pvx_fail(d, PVX_EINVAL, "%zu cameras have pictures: gains are between two or more",
                        with);
    for (int a = 0; a < 3; a++) {
        double gain[REC_MAX_CAMERAS];
        rec_light_gains(sum[a], n, gain);
        for (size_t c = 0; c < n; c++)
            l->rig.cameras[c].gain[a] = (float)gain[c];
    }
    for (size_t c = 0; c < n; c++)
        printf("%-12s gain %.4f %.4f %.4f\n", l->rig.cameras[c].name,
               (double)l->rig.cameras[c].gain[0], (double)l->rig.cameras[c].gain[1],
               (double)l->rig.cameras[c].gain[2]);
    return calibrate_light_save(l, d);
}

static error_t gain_parse(int key, char *arg, struct argp_state *st)
{
    struct gain_args *a = st->input;
    (void)arg;
    if (key == ARGP_KEY_INIT)
        st->child_inputs[0] = &a->light;
    else if (key == 'f')
        a->flame = true;
    else
        return ARGP_ERR_UNKNOWN;
    return 0;
}

int calibrate_gain(int argc, char **argv)
{
    static const struct argp_option options[] = {
        {"flame", 'f', NULL, 0, "the pictures are of a flame, not of an even source", 0}, {0}};
    const struct argp_child children[] = {{&calibrate_light_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {
        .options = options, .parser = gain_parse, .doc = gain_doc, .children = children};
    struct gain_args a = {0};
    if (argp_parse(&argp, argc, argv, 0, NULL, &a) != 0)
        return 2;
    by_flame = a.flame;
    return calibrate_light_run(&a.light, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK | DMN_LIGHT_FLAT,
                               gain_step);
}
