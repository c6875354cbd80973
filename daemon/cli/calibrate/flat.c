/* flat.c - `pyrovox calibrate flat`: vignetting and each pixel's own sensitivity, and the noise. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"

static const char doc[] =
    "Measure the sensitivity of each pixel, with vignetting, by an even source, and write it into "
    "rig.yaml.\vExamples:\n"
    "  pyrovox calibrate flat --rig rig2.yaml --frames a.h5 --frames b.h5 \\\n"
    "          --frames c.h5 --frames d.h5 --out rig3.yaml\n"
    "\n"
    "An evenly lit panel or sheet fills the pictures, at half of full scale. Give --frames for "
    "each of 4 places of it. Turn it by a quarter each time, so that its own shading cancels.\n"
    "Do this after dark. With 2 pictures or more at each place the noise is measured too (photon "
    "transfer). One place is refused: it cannot tell the lens from the source.";

/* Check that the pictures are of the camera of the darks.  Without darks take the camera's identity from them. */
static pvx_err flat_identity(struct calibrate_light *l, size_t c, struct pvx_diag *d)
{
    struct rec_camera *k = &l->rig.cameras[c];
    for (size_t g = 0; g < l->a->n; g++) {
        const struct calibrate_stack *s = calibrate_light_stack(l, g, c);
        const struct dmn_photometry_taken as = {NAN, NAN, NAN, s->serial, s->device};
        if (s->picture.n == 0)
            continue;
        if (k->photometry.dark.file[0] == '\0')
            calibrate_light_identity(s, &k->photometry);
        else
            PVX_TRY(dmn_photometry_check(k, &as, l->a->frames[g], d));
    }
    return PVX_OK;
}

static pvx_err flat_one(struct calibrate_light *l, size_t c, const struct rec_light_picture *p,
                        size_t m, struct pvx_diag *d)
{
    struct rec_camera *k = &l->rig.cameras[c];
    struct pvx_diag why = {""};
    struct rec_flat r;
    PVX_TRY(flat_identity(l, c, d));
    float *map =
        pvx_calloc((size_t)p->width * (size_t)p->height * (size_t)p->channels, sizeof *map);
    PVX_NEED(map);
    pvx_err e = rec_light_flat(p, m, map, &r, &why);
    e = e != PVX_OK ? calibrate_light_fail(k, e, &why, d)
                    : calibrate_light_map(l, c, "flat", map, &k->photometry.flat, d);
    free(map);
    if (e != PVX_OK)
        return e;
    printf("%-12s %zu places: down to %.2f of the middle, %.4f rms is left, %zu pixels marked\n",
           k->name, m, r.vignetting, r.residual, r.bad);
    /* without a dark, light would count from the pedestal */
    if (k->photometry.dark.file[0] != '\0' && calibrate_light_noise(k, p, m, &why) != PVX_OK)
        printf("%-12s noise not measured: %s\n", k->name, why.text);
    return PVX_OK;
}

static pvx_err flat_step(struct calibrate_light *l, struct pvx_diag *d)
{
    return calibrate_light_cameras(l, flat_one, d);
}

int calibrate_flat(int argc, char **argv)
{
    return calibrate_light_main(doc, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK, flat_step, argc, argv);
}
