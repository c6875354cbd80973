#include "daemon/volumes/vdb_kelvin.h"

#include <stdlib.h>

#include "base/mem.h"

#define CELLS ((size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK)

pvx_err vol_vdb_kelvin(struct vol_vdb_kelvin *k, const struct vol_volume *v, struct vol_volume *out)
{
    if (v->n_bricks > k->room) {
        vol_vdb_kelvin_free(k);
        k->density = pvx_calloc(v->n_bricks * CELLS, sizeof *k->density);
        PVX_NEED(k->density);
        k->room = v->n_bricks;
    }
    for (size_t i = 0; i < v->n_bricks * CELLS; i++)
        k->density[i] = v->brick[i] > 0 ? 1 : 0;
    *out = *v;
    out->brick = k->density;
    out->kelvin = v->brick;
    out->bars = (struct vol_bars){.sd = NULL};
    return PVX_OK;
}

void vol_vdb_kelvin_free(struct vol_vdb_kelvin *k)
{
    PVX_FREE(k->density);
    k->room = 0;
}
