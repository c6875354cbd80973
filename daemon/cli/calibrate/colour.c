/* colour.c - `pyrovox calibrate colour`: every camera's colours made those of one. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"

static const char doc[] =
    "Make every camera's colours those of one camera, by a matrix in rig.yaml.\vExamples:\n"
    "  pyrovox calibrate colour --rig rig4.yaml --frames red.h5 --frames green.h5 \\\n"
    "          --frames blue.h5 --out rig5.yaml\n"
    "\n"
    "Give --frames for each of 3 colours or more that fill the middle of all pictures, far from "
    "each other. Red, green and blue filters before the even source will do.\n"
    "Do this after gain, which does not change. It is only for colour cameras whose bins have "
    "three channels, not for Bayer pixels as rays.";

struct colour_args {
    struct calibrate_light_args light;
    const char *to;
};
static const char *to_camera; /* this program runs one step */

static pvx_err reference(const struct rec_rig *rig, size_t *out, struct pvx_diag *d)
{
    for (*out = 0; *out < rig->n_cameras; ++*out)
        if (to_camera == NULL || strcmp(rig->cameras[*out].name, to_camera) == 0)
            return PVX_OK;
    return pvx_fail(d, PVX_ENOENT, "--to %s: the rig has no such camera", to_camera);
}

/* Colours of camera c with its gain, [groups][3]. */
static pvx_err patches(const struct calibrate_light *l, size_t c, double *out, struct pvx_diag *d)
{
    const struct rec_camera *k = &l->rig.cameras[c];
    for (size_t g = 0; g < l->a->n; g++, out += 3) {
        const struct rec_light_picture *p = &calibrate_light_stack(l, g, c)->picture;
        if (p->n == 0)
            return pvx_fail(d, PVX_ENOENT, "%s: no pictures of camera %s", l->a->frames[g],
                            k->name);
        if (p->channels == 1 && p->cell == NULL)
            return pvx_fail(d, PVX_EINVAL, "camera %s is grey: it has no colours", k->name);
        if (p->saturated > 0.001)
            return pvx_fail(d, PVX_EINVAL,
                            "camera %s: %s is saturated in %.1f %% of its samples: expose less",
                            k->name, l->a->frames[g], 100 * p->saturated);
        rec_light_middle(p, out);
        if (!(fmax(out[0], fmax(out[1], out[2])) > 0.02))
            return pvx_fail(d, PVX_EINVAL,
                            "camera %s: %s is dark in the middle: the colour must be there, "
                            "brighter",
                            k->name, l->a->frames[g]);
        for (int a = 0; a < 3; a++)
            out[a] *= (double)k->gain[a];
    }
    return PVX_OK;
}

static pvx_err colour_step(struct calibrate_light *l, struct pvx_diag *d)
{
    double to[3 * CALIBRATE_GROUPS], from[3 * CALIBRATE_GROUPS], residual;
    size_t at;
    PVX_TRY(reference(&l->rig, &at, d));
    PVX_TRY(patches(l, at, to, d));
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        struct rec_camera *k = &l->rig.cameras[c];
        struct pvx_diag why = {""};
        PVX_TRY(patches(l, c, from, d));
        pvx_err e = rec_light_matrix(from, to, l->a->n, k->photometry.matrix, &residual, &why);
        if (e != PVX_OK)
            return calibrate_light_fail(k, e, &why, d);
        k->photometry.has_matrix = c != at; /* that camera stays as it is */
        if (c == at)
            printf("%-12s the others' colours become its\n", k->name);
        else
            printf("%-12s %.4f of their light is left, rms, of %zu colours\n", k->name, residual,
                   l->a->n);
    }
    return calibrate_light_save(l, d);
}

static error_t colour_parse(int key, char *arg, struct argp_state *st)
{
    struct colour_args *a = st->input;
    if (key == ARGP_KEY_INIT)
        st->child_inputs[0] = &a->light;
    else if (key == 't')
        a->to = arg;
    else
        return ARGP_ERR_UNKNOWN;
    return 0;
}

int calibrate_colour(int argc, char **argv)
{
    static const struct argp_option options[] = {
        {"to", 't', "CAMERA", 0, "the camera whose colours the others get (the rig's first)", 0},
        {0}};
    const struct argp_child children[] = {{&calibrate_light_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {
        .options = options, .parser = colour_parse, .doc = doc, .children = children};
    struct colour_args a = {0};
    if (argp_parse(&argp, argc, argv, 0, NULL, &a) != 0)
        return 2;
    to_camera = a.to;
    return calibrate_light_run(&a.light, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK | DMN_LIGHT_FLAT,
                               colour_step);
}
