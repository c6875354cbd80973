#include "daemon/volumes/voxels.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define SIDE PVP_BRICK

struct vol_voxels {
    struct pvp_grid grid;
    size_t count;
    uint32_t n;
    int32_t *index; /* [count], reserved */
    float *value;   /* [count][channels], reserved */
    float *sd;      /* [count][channels], reserved */
};

pvx_err vol_voxels_new(const struct pvp_grid *g, vol_voxels **out)
{
    *out = NULL;
    struct vol_voxels *x = calloc(1, sizeof *x);
    PVX_NEED(x);
    x->grid = *g;
    x->count = (size_t)g->n[0] * g->n[1] * g->n[2];
    x->index = pvx_reserve(x->count * sizeof *x->index);
    x->value = pvx_reserve(x->count * g->channels * sizeof *x->value);
    x->sd = pvx_reserve(x->count * g->channels * sizeof *x->sd);
    *out = x;
    if (x->index != NULL && x->value != NULL && x->sd != NULL)
        return PVX_OK;
    vol_voxels_free(out);
    return PVX_ENOMEM;
}

void vol_voxels_free(vol_voxels **xp)
{
    struct vol_voxels *x = *xp;
    if (x == NULL)
        return;
    if (x->index != NULL)
        pvx_unreserve(x->index, x->count * sizeof *x->index);
    if (x->value != NULL)
        pvx_unreserve(x->value, x->count * x->grid.channels * sizeof *x->value);
    if (x->sd != NULL)
        pvx_unreserve(x->sd, x->count * x->grid.channels * sizeof *x->sd);
    PVX_FREE(*xp);
}

static bool voxels_dark(const float *v, uint32_t channels)
{
    return v[0] == 0 && (channels == 1 || (v[1] == 0 && v[2] == 0));
}

/* One row of 8 voxels of a brick, which begins at voxel i0 of the row whose first voxel is number `row`.  sd may be NULL. */
static void voxels_add_row(struct vol_voxels *x, const float *in, const float *sd, uint32_t i0,
                           size_t row)
{
    const uint32_t channels = x->grid.channels;
    for (uint32_t i = 0; i < SIDE && i0 + i < x->grid.n[0]; i++) {
        const float *value = in + (size_t)i * channels;
        const float *bar = sd != NULL ? sd + (size_t)i * channels : NULL;
        if (voxels_dark(value, channels) && (bar == NULL || voxels_dark(bar, channels)))
            continue;
        x->index[x->n] = (int32_t)(row + i0 + i);
        memcpy(x->value + (size_t)x->n * channels, value, channels * sizeof *value);
        if (bar != NULL)
            memcpy(x->sd + (size_t)x->n * channels, bar, channels * sizeof *bar);
        x->n++;
    }
}

/* Add the voxels of layer k of bricks from..to, which lie in one row of bricks: for each j, those of all bricks. */
static void add_rows(struct vol_voxels *x, const struct vol_volume *v, uint32_t from, uint32_t to,
                     uint32_t k)
{
    const struct pvp_grid *g = &x->grid;
    const uint32_t nbx = (g->n[0] + SIDE - 1) / SIDE, nby = (g->n[1] + SIDE - 1) / SIDE;
    const uint32_t y0 = v->ids[from] / nbx % nby * SIDE, z0 = v->ids[from] / nbx / nby * SIDE;
    for (uint32_t j = 0; j < SIDE && y0 + j < g->n[1]; j++)
        for (uint32_t b = from; b < to; b++) {
            const size_t at = (((size_t)b * SIDE + k) * SIDE + j) * SIDE * g->channels;
            voxels_add_row(x, v->brick + at, v->bars.sd != NULL ? v->bars.sd + at : NULL,
                           v->ids[b] % nbx * SIDE, ((size_t)(z0 + k) * g->n[1] + y0 + j) * g->n[0]);
        }
}

/* The end of the bricks from `from` on that share ids / per. */
static uint32_t voxels_run_end(const struct vol_volume *v, uint32_t from, uint32_t end,
                               uint32_t per)
{
    uint32_t b = from;
    while (b < end && v->ids[b] / per == v->ids[from] / per)
        b++;
    return b;
}

void vol_voxels_bars(vol_voxels *x, const struct vol_volume *v, struct pvp_voxels *out,
                     struct pvp_voxels *sd)
{
    const struct pvp_grid *g = &x->grid;
    const uint32_t nbx = (g->n[0] + SIDE - 1) / SIDE, nby = (g->n[1] + SIDE - 1) / SIDE;
    x->n = 0;
    for (uint32_t slab = 0, end; slab < v->n_bricks; slab = end) {
        end = voxels_run_end(v, slab, v->n_bricks, nbx * nby);
        const uint32_t z0 = v->ids[slab] / nbx / nby * SIDE;
        for (uint32_t k = 0; k < SIDE && z0 + k < g->n[2]; k++)
            for (uint32_t row = slab, row_end; row < end; row = row_end) {
                row_end = voxels_run_end(v, row, end, nbx);
                add_rows(x, v, row, row_end, k);
            }
    }
    *out = (struct pvp_voxels){x->n, x->index, x->value, (int)g->channels};
    *sd = (struct pvp_voxels){v->bars.sd != NULL ? x->n : 0, x->index, x->sd, (int)g->channels};
}

void vol_voxels_of(vol_voxels *x, const struct vol_volume *v, struct pvp_voxels *out)
{
    struct vol_volume bare = *v;
    struct pvp_voxels none;
    bare.bars = (struct vol_bars){0};
    vol_voxels_bars(x, &bare, out, &none);
}
