#include "daemon/volumes/bricks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define B PVP_BRICK

pvx_err vol_store_grow(struct vol_store *s, uint32_t bricks, uint32_t channels)
{
    if (bricks <= s->room)
        return PVX_OK;
    vol_store_free(s);
    s->ids = malloc(bricks * sizeof *s->ids);
    s->brick = malloc((size_t)bricks * B * B * B * channels * sizeof *s->brick);
    if (s->ids == NULL || s->brick == NULL) {
        vol_store_free(s);
        return PVX_ENOMEM;
    }
    s->room = bricks;
    return PVX_OK;
}

void vol_store_free(struct vol_store *s)
{
    free(s->ids);
    free(s->brick);
    *s = (struct vol_store){0};
}

/* Where a brick lies: its first voxel, and how many of it are inside the grid. */
struct place {
    uint32_t at[3], in[3];
};

static struct place place(const struct pvp_grid *g, const uint32_t nb[3], uint32_t id)
{
    struct place p = {.at = {id % nb[0] * B, id / nb[0] % nb[1] * B, id / nb[0] / nb[1] * B}};
    for (int a = 0; a < 3; a++)
        p.in[a] = g->n[a] - p.at[a] < B ? g->n[a] - p.at[a] : B;
    return p;
}

static size_t row_at(const struct pvp_grid *g, const struct place *p, uint32_t j, uint32_t k)
{
    return (((size_t)(p->at[2] + k) * g->n[1] + p->at[1] + j) * g->n[0] + p->at[0]) * g->channels;
}

void vol_to_dense(const struct vol_volume *v, float *dense)
{
    const struct pvp_grid *g = &v->v.grid;
    uint32_t nb[3], c = g->channels;
    pvp_grid_bricks(g, nb);
    for (uint32_t b = 0; b < v->n_bricks; b++) {
        struct place p = place(g, nb, v->ids[b]);
        const float *brick = v->brick + (size_t)b * B * B * B * c;
        for (uint32_t k = 0; k < p.in[2]; k++)
            for (uint32_t j = 0; j < p.in[1]; j++)
                memcpy(dense + row_at(g, &p, j, k), brick + (size_t)(k * B + j) * B * c,
                       (size_t)p.in[0] * c * sizeof *dense);
    }
}

/* One brick out of the volume; false when it is all 0. */
static bool gather(const struct pvp_grid *g, const struct place *p, const float *dense,
                   float *brick, bool *finite)
{
    uint32_t c = g->channels;
    bool any = false;
    memset(brick, 0, (size_t)B * B * B * c * sizeof *brick);
    for (uint32_t k = 0; k < p->in[2]; k++)
        for (uint32_t j = 0; j < p->in[1]; j++) {
            const float *from = dense + row_at(g, p, j, k);
            float *to = brick + (size_t)(k * B + j) * B * c;
            for (uint32_t i = 0; i < p->in[0] * c; i++) {
                any |= from[i] != 0;
                *finite &= isfinite(from[i]) != 0;
                to[i] = from[i];
            }
        }
    return any;
}

pvx_err vol_from_dense(struct vol_store *s, const struct pvp_grid *g, const float *dense)
{
    uint32_t nb[3], all = pvp_grid_bricks(g, nb);
    size_t cells = (size_t)B * B * B * g->channels;
    bool finite = true;
    PVX_TRY(vol_store_grow(s, all, g->channels));
    s->n = 0;
    for (uint32_t id = 0; id < all; id++) {
        struct place p = place(g, nb, id);
        if (gather(g, &p, dense, s->brick + s->n * cells, &finite))
            s->ids[s->n++] = id;
    }
    return finite ? PVX_OK : PVX_ECORRUPT;
}
