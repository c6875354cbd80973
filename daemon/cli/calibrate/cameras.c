#include "daemon/cli/calibrate/cameras.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/mem.h"

static int cameras_by_name(const void *a, const void *b)
{
    return strcmp(((const struct rec_camera *)a)->name, ((const struct rec_camera *)b)->name);
}

/* The rig of the configuration, when it has been made already. */
static pvx_err old_rig(const struct dmn_config *c, struct rec_rig *old, struct pvx_diag *d)
{
    char path[PATH_MAX];
    *old = (struct rec_rig){0};
    if (c->rig[0] == '\0')
        return PVX_OK;
    dmn_config_path(c, c->rig, path, sizeof path);
    return access(path, F_OK) == 0 ? rec_rig_load(path, old, d) : PVX_OK;
}

static pvx_err named(const struct dmn_config *c, const struct rec_rig *old, struct rec_rig *rig,
                     struct pvx_diag *d)
{
    if (c->cameras.n > REC_MAX_CAMERAS)
        return pvx_fail(d, PVX_ERANGE, "%s: cameras: %zu; at most %d are possible", c->name,
                        c->cameras.n, REC_MAX_CAMERAS);
    rig->grid = old->grid;
    if ((rig->cameras = pvx_calloc(c->cameras.n, sizeof *rig->cameras)) == NULL)
        return PVX_ENOMEM;
    rig->n_cameras = c->cameras.n;
    for (size_t i = 0; i < rig->n_cameras; i++) {
        struct rec_camera *k = &rig->cameras[i];
        if (!rec_rig_name_ok(c->cameras.item[i].key))
            return pvx_fail(d, PVX_EINVAL,
                            "%s: cameras: '%s' is a name that no camera can have: letters, digits "
                            "and . _ - only, at most %d",
                            c->name, c->cameras.item[i].key, REC_NAME_MAX - 1);
        int was = old->cameras != NULL ? rec_rig_find(old, c->cameras.item[i].key) : -1;
        snprintf(k->name, sizeof k->name, "%.*s", (int)sizeof k->name - 1, c->cameras.item[i].key);
        k->width = was >= 0 ? old->cameras[was].width : 0;
        k->height = was >= 0 ? old->cameras[was].height : 0;
    }
    qsort(rig->cameras, rig->n_cameras, sizeof *rig->cameras, cameras_by_name);
    return PVX_OK;
}

static pvx_err calibrate_cameras_find(struct dmn_config *c, struct calibrate_cameras *s,
                                      struct pvx_diag *d)
{
    struct rec_rig old;
    bool each = c->cameras.n > 0 && c->cameras.item[0].key[0] != '\0';
    PVX_TRY(old_rig(c, &old, d));
    pvx_err e = PVX_OK;
    if (each)
        e = named(c, &old, &s->rig, d);
    else if (c->cameras.n == 0)
        e = pvx_fail(d, PVX_EINVAL,
                     "%s: cameras: there are none; `pyrovox cameras` lists what can be found",
                     c->name);
    else if (old.n_cameras == 0)
        e = pvx_fail(d, PVX_EINVAL,
                     "%s: cameras: '%s' is for all cameras of a rig, but there is no rig yet: name "
                     "each one, as cameras: {cam0: \"aravis:192.168.1.21\", cam1: ...}",
                     c->name, c->cameras.item[0].value);
    else
        e = rec_rig_copy(&old, &s->rig);
    rec_rig_fini(&old);
    if (e == PVX_OK && dmn_config_simulated(c))
        e = pvx_fail(d, PVX_EUNSUP,
                     "%s: cameras: sim: cameras look at a flame; `pyrovox simcams --board` has "
                     "cameras that look at a board",
                     c->name);
    return e;
}

pvx_err calibrate_cameras_init(struct calibrate_cameras *s, const char *config, struct pvx_diag *d)
{
    memset(s, 0, sizeof *s);
    struct dmn_config *c = s->config = pvx_calloc(1, sizeof *c);
    PVX_NEED(c);
    pvx_err e = dmn_config_load(config, c, d);
    PVX_THEN(e, calibrate_cameras_find(c, s, d));
    c->min_cameras = c->min_views = 1; /* every picture counts */
    PVX_THEN(e, dmn_sources_init(&s->sources, c, &s->rig, NULL, d));
    s->sources.capture.sets.policy = CAP_POLICY_PARTIAL;
    s->sources.capture.sets.min_cameras = 1;
    return e;
}

void calibrate_cameras_fini(struct calibrate_cameras *s)
{
    rec_rig_fini(&s->rig);
    PVX_FREE(s->config);
}
