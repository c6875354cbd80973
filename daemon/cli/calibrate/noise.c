/* noise.c - `pyrovox calibrate noise`: read noise and gain of each camera, by photon transfer. */
#include <math.h>
#include <stdio.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"

static const char doc[] =
    "Read noise and gain of each camera by photon transfer, into rig.yaml.\v"
    "A still scene under steady light; a --frames for each of 2 levels or more, from caps on to "
    "nearly full, by exposure or by the lamp, 8 pictures each (at least 2): darks and flats will "
    "do:\n"
    "  pyrovox calibrate noise --rig rig3.yaml --frames darks.h5 --frames dim.h5 --frames half.h5 "
    "--frames bright.h5 --out rig4.yaml\n"
    "After dark. Flicker of the whole light up to 2 % is taken out.";

static pvx_err noise_step(struct calibrate_light *l, struct pvx_diag *d)
{
    size_t with = 0;
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        struct rec_camera *k = &l->rig.cameras[c];
        struct rec_light_picture p[CALIBRATE_GROUPS];
        struct rec_noise noise;
        struct pvx_diag why = {""};
        size_t m = calibrate_light_of(l, c, p);
        if (m == 0)
            continue;
        if (k->photometry.dark.file[0] == '\0')
            return pvx_fail(d, PVX_EINVAL,
                            "camera %s: %s has no dark of it, above which light counts: measure "
                            "that first (pyrovox calibrate dark)",
                            k->name, l->a->rig);
        pvx_err e = rec_light_noise(p, m, &noise, &why);
        if (e != PVX_OK)
            return calibrate_light_fail(k, e, &why, d);
        k->photometry.has_noise = true;
        k->photometry.read_noise = fmin(noise.read, 1);
        k->photometry.noise_gain = fmin(noise.gain, 1);
        printf("%-12s variance = %.5f^2 + %.3g * light (full scale = 1), %zu levels\n", k->name,
               noise.read, noise.gain, m);
        with++;
    }
    if (with == 0)
        return pvx_fail(d, PVX_ENOENT, "no camera of the rig has pictures");
    return calibrate_light_save(l, d);
}

int calibrate_noise(int argc, char **argv)
{
    struct calibrate_light_args a;
    if (calibrate_light_parse(&a, doc, argc, argv) != 0)
        return 2;
    return calibrate_light_run(&a, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK, noise_step);
}
