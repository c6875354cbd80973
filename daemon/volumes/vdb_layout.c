#include "daemon/volumes/vdb_layout.h"

/* World of the index coordinates of openvdb_shim.h: with y up the axes are x, z, -y. */
void vol_vdb_place(const struct vol_vdb_about *a, struct vol_vdb_bricks *b)
{
    const struct pvp_grid *g = &a->v.grid;
    for (int i = 0; i < 3; i++) {
        int axis = a->y_up && i > 0 ? 3 - i : i;
        double spacing = (g->max[axis] - g->min[axis]) / g->n[axis];
        double corner = a->y_up && i == 2 ? -g->min[1] : g->min[axis];
        b->n[i] = g->n[i];
        b->spacing[i] = spacing / a->unit_m;
        b->origin[i] = (corner + spacing / 2) / a->unit_m;
    }
    b->channels = g->channels;
    b->split = a->split != 0;
    b->y_up = a->y_up != 0;
}

void vol_vdb_lay(struct vol_vdb_about *about, const struct vol_volume *v, struct vol_vdb_note *note,
                 struct vol_vdb_bricks *out)
{
    about->v = v->v;
    about->sample = v->sample;
    about->clamped = v->clamped;
    about->bars = v->bars.sd != NULL;
    about->doubt = v->bars.doubt;
    *out = (struct vol_vdb_bricks){.n_bricks = v->n_bricks,
                                   .ids = v->ids,
                                   .brick = v->brick,
                                   .sd = v->bars.sd,
                                   .kelvin = v->kelvin,
                                   .notes = note,
                                   .n_notes = vol_vdb_notes_make(about, note)};
    vol_vdb_place(about, out);
}
