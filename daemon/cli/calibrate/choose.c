#include "daemon/cli/calibrate/choose.h"

#include <stdlib.h>
#include <string.h>

#define STAYS (REC_HOLD_LENS | REC_HOLD_POSE)

pvx_err calibrate_only(struct calibrate_look *l, struct pvx_diag *d)
{
    size_t n = 0;
    if (l->from == 0 && l->to == REC_NO_FRAME)
        return PVX_OK;
    for (size_t c = 0; c < l->n_cameras; c++)
        l->count[c].pictures = 0;
    for (size_t i = 0; i < l->n; i++) {
        struct calibrate_picture *p = &l->picture[i];
        if (p->frame < l->from || p->frame > l->to) {
            free(p->path);
            continue;
        }
        l->count[p->camera].pictures++;
        l->picture[n++] = *p;
    }
    l->n = n;
    for (size_t c = 0; c < l->n_cameras; c++)
        if (l->count[c].pictures == 0)
            return pvx_fail(d, PVX_EINVAL,
                            "%s: no picture has a number from %u to %u; see --from and --to",
                            l->camera[c].name, l->from, l->to);
    return PVX_OK;
}

static bool listed(const struct calibrate_names *o, const char *name)
{
    for (size_t i = 0; i < o->n; i++)
        if (strcmp(o->name[i], name) == 0)
            return true;
    return false;
}

/* Check the named cameras: each has pictures, and the old rig lacks it (--add) or has it (--recover). */
static pvx_err choose_known(const struct calibrate_look *l, const struct rec_rig *old,
                            const struct calibrate_names *o, bool add, struct pvx_diag *d)
{
    for (size_t i = 0; i < o->n; i++) {
        const char *name = o->name[i], *option = add ? "--add" : "--recover";
        if (calibrate_camera(l, name, strlen(name)) == l->n_cameras)
            return pvx_fail(d, PVX_EINVAL, "%s %s: there are no pictures of it", option, name);
        if (add == (rec_rig_find(old, name) >= 0))
            return pvx_fail(d, PVX_EINVAL,
                            add ? "%s %s: the old rig has it already; --recover %s finds its pose "
                                  "anew, for a new lens take it out of the old rig"
                                : "%s %s: the old rig does not have it; --add %s is for a new one",
                            option, name, name);
    }
    return PVX_OK;
}

pvx_err calibrate_hold(struct calibrate_look *l, const struct rec_rig *old,
                       const struct calibrate_names *add, const struct calibrate_names *recover,
                       struct pvx_diag *d)
{
    size_t stay = 0;
    PVX_TRY(choose_known(l, old, add, true, d));
    PVX_TRY(choose_known(l, old, recover, false, d));
    for (size_t c = 0; c < l->n_cameras; c++) {
        struct rec_calib_camera *k = &l->camera[c];
        bool is_new = listed(add, k->name);
        if (!is_new && rec_rig_find(old, k->name) < 0)
            return pvx_fail(d, PVX_EINVAL,
                            "%s: the old rig does not have it: --add %s too, or leave its pictures "
                            "out",
                            k->name, k->name);
        k->hold = is_new ? 0 : listed(recover, k->name) ? REC_HOLD_LENS : STAYS;
        stay += k->hold == STAYS;
    }
    if (stay == 0)
        return pvx_fail(d, PVX_EINVAL,
                        "no camera stays as it is in the old rig: give pictures of one that does, "
                        "which sees the board together with the other");
    return PVX_OK;
}

pvx_err calibrate_merge(const struct calibrate_look *l, const struct rec_rig *old,
                        struct rec_rig *rig, struct pvx_diag *d)
{
    struct rec_rig all = {.grid = old->grid, .n_cameras = old->n_cameras};
    if ((all.cameras = calloc(old->n_cameras + rig->n_cameras, sizeof *all.cameras)) == NULL)
        return PVX_ENOMEM;
    memcpy(all.cameras, old->cameras, old->n_cameras * sizeof *all.cameras);
    for (size_t c = 0; c < rig->n_cameras; c++) {
        int was = rec_rig_find(old, rig->cameras[c].name);
        if (l->camera[c].hold != STAYS)
            all.cameras[was >= 0 ? (size_t)was : all.n_cameras++] = rig->cameras[c];
    }
    rec_rig_fini(rig);
    *rig = all;
    PVX_TRY(rec_bodies_copy(&old->bodies, &rig->bodies));
    return all.n_cameras <= REC_MAX_CAMERAS
               ? PVX_OK
               : pvx_fail(d, PVX_ERANGE, "more than %d cameras", REC_MAX_CAMERAS);
}
