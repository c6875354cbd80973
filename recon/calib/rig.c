/* rig.c - the estimate so far, as a rig. */
#include <stdio.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

bool rec_calib_stays(const struct calib *k, size_t camera)
{
    const unsigned both = REC_HOLD_LENS | REC_HOLD_POSE;
    return (k->in->camera[camera].hold & both) == both;
}

pvx_err rec_calib_rig(const struct calib *k, struct rec_rig *rig)
{
    *rig = (struct rec_rig){.grid = k->in->grid};
    rig->cameras = pvx_calloc(k->nc, sizeof *rig->cameras);
    if (rig->cameras == NULL)
        return PVX_ENOMEM;
    rig->n_cameras = k->nc;
    if (k->in->options.world == REC_WORLD_OLD) /* else bodies have no place */
        PVX_TRY(rec_bodies_copy(&k->in->options.old->bodies, &rig->bodies));
    for (size_t c = 0; c < k->nc; c++) {
        struct rec_camera *to = &rig->cameras[c];
        const struct rec_calib_camera *m = &k->in->camera[c];
        const struct rec_rig *old = k->in->options.old;
        int was = old != NULL ? rec_rig_find(old, m->name) : -1;
        if (was >= 0) /* keep all that is not geometry */
            *to = old->cameras[was];
        else
            to->gain[0] = to->gain[1] = to->gain[2] = 1;
        snprintf(to->name, sizeof to->name, "%s", m->name);
        to->width = m->width;
        to->height = m->height;
        to->uncertainty = (struct rec_uncertainty){0};
        const double *l = k->lens[c];
        to->fx = l[REC_FX];
        to->fy = l[REC_FY];
        to->cx = l[REC_CX];
        to->cy = l[REC_CY];
        memset(to->dist, 0, sizeof to->dist);
        memcpy(to->dist, l + REC_K1, 5 * sizeof *l);
        if ((m->hold & REC_HOLD_POSE) == 0) {
            rec_rotation(k->pose[c], to->R);
            memcpy(to->t, k->pose[c] + 3, sizeof to->t);
            rec_calib_glaze(k->window[c], k->windows[c], to);
        }
    }
    if (rig->grid.n[0] == 0 && rec_rig_finest(rig, 1, rig->grid.n) != PVX_OK)
        for (int a = 0; a < 3; a++)
            rig->grid.n[a] = 64; /* no camera sees its middle; the verdict says so */
    return PVX_OK;
}
