/* noise.c - `pyrovox calibrate noise`: read noise and gain of each camera, by photon transfer. */
#include <stdio.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"

static const char doc[] =
    "Measure read noise and gain of each camera by photon transfer, and write them into "
    "rig.yaml.\vExamples:\n"
    "  pyrovox calibrate noise --rig rig3.yaml --frames darks.h5 --frames dim.h5 \\\n"
    "          --frames half.h5 --frames bright.h5 --out rig4.yaml\n"
    "\n"
    "Take a still scene under steady light. Give --frames for each of 2 levels or more, from caps "
    "on to nearly full, by exposure or by the lamp, with 8 pictures each (at least 2). Darks and "
    "flats will do.\n"
    "Do this after dark. Flicker of the whole light up to 2 % is removed.";

static pvx_err noise_one(struct calibrate_light *l, size_t c, const struct rec_light_picture *p,
                         size_t m, struct pvx_diag *d)
{
    struct rec_camera *k = &l->rig.cameras[c];
    struct pvx_diag why = {""};
    if (k->photometry.dark.file[0] == '\0')
        return pvx_fail(d, PVX_EINVAL,
                        "camera %s: %s has no dark of it, and light counts from the dark: run "
                        "`pyrovox calibrate dark` first",
                        k->name, l->a->rig);
    pvx_err e = calibrate_light_noise(k, p, m, &why);
    return e == PVX_OK ? e : calibrate_light_fail(k, e, &why, d);
}

static pvx_err noise_step(struct calibrate_light *l, struct pvx_diag *d)
{
    return calibrate_light_cameras(l, noise_one, d);
}

int calibrate_noise(int argc, char **argv)
{
    return calibrate_light_main(doc, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK, noise_step, argc, argv);
}
