#include "daemon/volumes/share.h"

#include <stdlib.h>

#include "daemon/volumes/segment.h"
#include "daemon/volumes/vdb_layout.h"
#include "daemon/volumes/vdb_module.h"

struct vol_share {
    const struct vol_vdb *module;
    vol_segment *segment;
    const char *name;
    bool split;
    struct vol_vdb_about about;
    struct vol_vdb_note note[VOL_VDB_NOTES_MAX];
};

pvx_err vol_share_new(const struct vol_share_config *c, vol_share **out, struct pvx_diag *d)
{
    *out = NULL;
    struct vol_share *s = calloc(1, sizeof *s);
    PVX_NEED(s);
    s->name = c->name;
    s->split = c->split;
    pvx_err e = vol_vdb_need(c->name, &s->module, d);
    PVX_THEN(e, vol_segment_new(c->name, c->mode, &s->segment, d));
    if (e != PVX_OK)
        free(s);
    else
        *out = s;
    return e;
}

/* Slots that hold every brick of the grid. */
static pvx_err share_make_room(struct vol_share *s, const struct vol_vdb_bricks *b,
                               struct pvx_diag *d)
{
    struct vol_vdb_bricks all = *b;
    uint32_t nb[3];
    all.n_bricks = pvp_grid_bricks(&s->about.v.grid, nb);
    uint64_t slot = s->module->nano_room(&all);
    if (slot < vol_segment_slot_size(s->segment))
        slot = vol_segment_slot_size(s->segment);
    if (slot == vol_segment_slot_size(s->segment) && vol_segment_named(s->segment))
        return PVX_OK;
    return vol_segment_room(s->segment, slot, s->module->nano_version, d);
}

static uint32_t share_grids(const struct vol_vdb_bricks *b)
{
    const uint32_t volume = b->channels == 1 ? 1 : b->split ? 4 : 2;
    return b->sd == NULL ? volume : 2 * volume - (volume == 4);
}

pvx_err vol_share_put(vol_share *s, const struct pvp_start *start, const struct vol_volume *v,
                      struct pvx_diag *d)
{
    struct vol_vdb_bricks b;
    void *grids;
    size_t size;
    char err[256] = "";
    if (strcmp(start->units, VOL_UNITS_KELVIN) == 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: temperatures are not shared, since a renderer would take them for "
                        "light: `pyrovox record --format vdb` writes them as a grid of their own",
                        s->name);
    s->about.start = *start;
    s->about.split = s->split && v->v.grid.channels == 3;
    s->about.unit_m = 1;
    vol_vdb_lay(&s->about, v, s->note, &b);
    PVX_TRY(share_make_room(s, &b, d));
    PVX_TRY(vol_segment_begin(s->segment, s->module->nano_room(&b), &grids, d));
    int e = s->module->nano_make(&b, grids, &size, err, sizeof err);
    if (e != PVX_OK)
        return vol_vdb_error(e, s->name, err, d);
    vol_segment_commit(s->segment, &(struct pvp_share_slot){
                                       .set = v->v.set,
                                       .session = v->v.session,
                                       .t_exposure_ns = v->v.t_exposure_ns,
                                       .t_publish_ns = v->v.t_publish_ns,
                                       .size = size,
                                       .n_grids = share_grids(&b),
                                       .flags = v->clamped ? PVP_FLAG_CLAMPED : 0,
                                   });
    return PVX_OK;
}

void vol_share_free(vol_share **sp)
{
    if (*sp == NULL)
        return;
    vol_segment_free(&(*sp)->segment);
    free(*sp);
    *sp = NULL;
}
