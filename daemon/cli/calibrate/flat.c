/* flat.c - `pyrovox calibrate flat`: vignetting and each pixel's own sensitivity, and the noise. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"

static const char doc[] = "Sensitivity of each pixel, vignetting with it, from pictures of an even "
                          "source, into rig.yaml.\v"
                          "An evenly lit panel or sheet fills the pictures, at half of full scale; "
                          "--frames for each of 4 places of "
                          "it, turned by a quarter each time, so that its own shading cancels:\n"
                          "  pyrovox calibrate flat --rig rig2.yaml --frames a.h5 --frames b.h5 "
                          "--frames c.h5 --frames d.h5 "
                          "--out rig3.yaml\n"
                          "After dark. With 2 pictures or more to a place the noise is measured "
                          "too (photon transfer). One place is "
                          "refused: it cannot tell the lens from the source.";

static void measure_noise(struct rec_camera *k, const struct rec_light_picture *p, size_t m)
{
    struct rec_noise noise;
    struct rec_photometry *to = &k->photometry;
    struct pvx_diag why = {""};
    if (to->dark.file[0] == '\0') /* light would count from the pedestal */
        return;
    if (rec_light_noise(p, m, &noise, &why) != PVX_OK) {
        printf("%-12s noise not measured: %s\n", k->name, why.text);
        return;
    }
    to->has_noise = true;
    to->read_noise = fmin(noise.read, 1);
    to->noise_gain = fmin(noise.gain, 1);
    printf("%-12s noise: variance = %.5f^2 + %.3g * light (full scale = 1)\n", k->name, noise.read,
           noise.gain);
}

/* The camera that the darks are of, or, without any, the one that these are of from now on. */
static pvx_err who(struct calibrate_light *l, size_t c, struct pvx_diag *d)
{
    struct rec_camera *k = &l->rig.cameras[c];
    for (size_t g = 0; g < l->a->n; g++) {
        const struct calibrate_stack *s = calibrate_light_stack(l, g, c);
        const struct dmn_photometry_taken as = {NAN, NAN, NAN, s->serial, s->device};
        if (s->picture.n == 0)
            continue;
        if (k->photometry.dark.file[0] == '\0')
            calibrate_light_who(s, &k->photometry);
        else
            PVX_TRY(dmn_photometry_check(k, &as, l->a->frames[g], d));
    }
    return PVX_OK;
}

static pvx_err flat_one(struct calibrate_light *l, size_t c, struct pvx_diag *d)
{
    struct rec_camera *k = &l->rig.cameras[c];
    struct rec_light_picture p[CALIBRATE_GROUPS];
    struct pvx_diag why = {""};
    struct rec_flat r;
    size_t m = calibrate_light_of(l, c, p);
    if (m == 0)
        return PVX_OK;
    PVX_TRY(who(l, c, d));
    float *map =
        pvx_calloc((size_t)p->width * (size_t)p->height * (size_t)p->channels, sizeof *map);
    if (map == NULL)
        return PVX_ENOMEM;
    pvx_err e = rec_light_flat(p, m, map, &r, &why);
    e = e != PVX_OK ? calibrate_light_fail(k, e, &why, d)
                    : calibrate_light_map(l, c, "flat", map, &k->photometry.flat, d);
    free(map);
    if (e != PVX_OK)
        return e;
    printf("%-12s %zu places: down to %.2f of the middle, %.4f rms is left, %zu pixels marked\n",
           k->name, m, r.vignetting, r.residual, r.bad);
    measure_noise(k, p, m);
    return PVX_OK;
}

static pvx_err flat_step(struct calibrate_light *l, struct pvx_diag *d)
{
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        PVX_TRY(flat_one(l, c, d));
    return calibrate_light_save(l, d);
}

int calibrate_flat(int argc, char **argv)
{
    struct calibrate_light_args a;
    if (calibrate_light_parse(&a, doc, argc, argv) != 0)
        return 2;
    return calibrate_light_run(&a, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK, flat_step);
}
