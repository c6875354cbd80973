/* dark.c - `pyrovox calibrate dark`: what cameras see with their caps on. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"
#include "recon/carve/clipped.h"

static const char doc[] =
    "Measure the mean of dark pictures per camera, mark hot and dead pixels, and write both into "
    "rig.yaml.\vExamples:\n"
    "  pyrovox calibrate dark --rig rig.yaml --frames darks.h5 --out rig2.yaml\n"
    "\n"
    "Put the caps on. Exposure, gain and temperature must be those of the flame. Take 16 pictures "
    "or more.\n"
    "A dark is subtracted from each picture, and marked pixels are left out. It holds for its "
    "exposure, gain and temperature (5 degrees): other takes are refused. Every camera of the rig "
    "that has pictures gets a dark.";

static pvx_err dark_one(struct calibrate_light *l, size_t c, const struct rec_light_picture *pic,
                        size_t m, struct pvx_diag *d)
{
    (void)m; /* one group */
    struct rec_camera *k = &l->rig.cameras[c];
    struct rec_photometry *p = &k->photometry;
    const struct calibrate_stack *s = calibrate_light_stack(l, 0, c);
    struct pvx_diag why = {""};
    struct rec_dark r;
    size_t n = (size_t)pic->width * (size_t)pic->height * (size_t)pic->channels;
    float *map = pvx_calloc(n, sizeof *map);
    PVX_NEED(map);
    pvx_err e = rec_light_dark(pic, map, &r, &why);
    e = e != PVX_OK ? calibrate_light_fail(k, e, &why, d)
                    : calibrate_light_map(l, c, "dark", map, &p->dark, d);
    free(map);
    if (e != PVX_OK)
        return e;
    p->has_exposure = isfinite(pic->exposure);
    p->exposure = p->has_exposure ? pic->exposure : 0;
    p->has_gain = isfinite(s->gain);
    p->gain_db = p->has_gain ? s->gain : 0;
    p->has_temperature = isfinite(s->temperature);
    p->temperature = p->has_temperature ? s->temperature : 0;
    calibrate_light_identity(s, p);
    printf(
        "%-12s %u pictures: level %.4f, noise of a picture %.5f (full scale = 1), %zu hot and %zu "
        "dead pixels\n",
        k->name, pic->n, r.level, r.read, r.hot, r.dead);
    if (rec_photo_say_cut(r.cut, r.pedestal, why.text))
        printf("%-12s %s; then take the darks again: these are too bright by what is cut\n", "",
               why.text);
    return PVX_OK;
}

static pvx_err dark_step(struct calibrate_light *l, struct pvx_diag *d)
{
    if (l->a->n != 1)
        return pvx_fail(
            d, PVX_EINVAL,
            "a rig has darks of one exposure: give one --frames, and a rig for each exposure");
    return calibrate_light_cameras(l, dark_one, d);
}

int calibrate_dark(int argc, char **argv)
{
    return calibrate_light_main(doc, DMN_LIGHT_RESPONSE, dark_step, argc, argv);
}
