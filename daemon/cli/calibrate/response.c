/* response.c - `pyrovox calibrate response`: light of a sample, from a ladder of exposures. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"

static const char doc[] =
    "Measure the light of each sample value from exposures of one unmoved scene, and write it into "
    "rig.yaml.\vExamples:\n"
    "  pyrovox calibrate response --rig rig.yaml --out rig2.yaml \\\n"
    "          --frames a --exposure 0.2 --frames b --exposure 0.4 \\\n"
    "          --frames c --exposure 0.6 --frames d --exposure 1.2 \\\n"
    "          --frames e --exposure 2 --frames f --exposure 4\n"
    "\n"
    "The light is steady and nothing moves. Take 6 exposures or more from nearly dark to nearly "
    "full, at most a factor of 2 apart, in uneven steps. Takes contain their exposure.\n"
    "Do this first of all steps. Darks and flats are measured in light, so those of the rig are "
    "removed.";

static pvx_err response_one(struct calibrate_light *l, size_t c, const struct rec_light_picture *p,
                            size_t m, struct pvx_diag *d)
{
    struct rec_camera *k = &l->rig.cameras[c];
    struct rec_photometry *to = &k->photometry;
    struct pvx_diag why = {""};
    struct rec_response r;
    double bend = 0;
    pvx_err e = rec_light_response(p, m, &r, &why);
    if (e != PVX_OK)
        return calibrate_light_fail(k, e, &why, d);
    to->n_response = REC_RESPONSE_KNOTS;
    memcpy(to->response, r.value, sizeof r.value);
    memset(&to->dark, 0, sizeof to->dark);
    memset(&to->flat, 0, sizeof to->flat);
    to->has_noise = false;
    for (int i = 0; i < REC_RESPONSE_KNOTS; i++)
        bend = fmax(bend, fabs(r.value[i] - (double)i / (REC_RESPONSE_KNOTS - 1)));
    printf(
        "%-12s %zu exposures: %.3f of full scale from a straight line at most, %.5f rms is left\n",
        k->name, m, bend, r.residual);
    return PVX_OK;
}

static pvx_err response_step(struct calibrate_light *l, struct pvx_diag *d)
{
    return calibrate_light_cameras(l, response_one, d);
}

int calibrate_response(int argc, char **argv)
{
    return calibrate_light_main(doc, 0, response_step, argc, argv);
}
