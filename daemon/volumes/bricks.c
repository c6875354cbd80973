#include "daemon/volumes/bricks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define B PVP_BRICK

pvx_err vol_store_grow(struct vol_store *s, uint32_t bricks, uint32_t channels)
{
    if (bricks <= s->room && channels == s->channels)
        return PVX_OK;
    size_t n = bricks > 0 ? bricks : 1;
    vol_store_free(s);
    s->ids = malloc(n * sizeof *s->ids);
    s->brick = malloc(n * B * B * B * channels * sizeof *s->brick);
    if (s->ids == NULL || s->brick == NULL) {
        vol_store_free(s);
        return PVX_ENOMEM;
    }
    s->room = bricks;
    s->channels = channels;
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

static struct place bricks_place(const struct pvp_grid *g, const uint32_t nb[3], uint32_t id)
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
        struct place p = bricks_place(g, nb, v->ids[b]);
        const float *brick = v->brick + (size_t)b * B * B * B * c;
        for (uint32_t k = 0; k < p.in[2]; k++)
            for (uint32_t j = 0; j < p.in[1]; j++)
                memcpy(dense + row_at(g, &p, j, k), brick + (size_t)(k * B + j) * B * c,
                       (size_t)p.in[0] * c * sizeof *dense);
    }
}

/* One brick out of the volume; false when it is all 0. */
static bool bricks_gather(const struct pvp_grid *g, const struct place *p, const float *dense,
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
        struct place p = bricks_place(g, nb, id);
        if (bricks_gather(g, &p, dense, s->brick + s->n * cells, &finite))
            s->ids[s->n++] = id;
    }
    return finite ? PVX_OK : PVX_ECORRUPT;
}

pvx_err vol_from_dense_bars(struct vol_store *s, struct vol_store *bars, const struct pvp_grid *g,
                            const float *dense, const float *sd)
{
    uint32_t nb[3], all = pvp_grid_bricks(g, nb);
    size_t cells = (size_t)B * B * B * g->channels;
    bool finite = true;
    PVX_TRY(vol_store_grow(s, all, g->channels));
    PVX_TRY(vol_store_grow(bars, all, g->channels));
    s->n = 0;
    for (uint32_t id = 0; id < all; id++) {
        struct place p = bricks_place(g, nb, id);
        bool lit = bricks_gather(g, &p, dense, s->brick + s->n * cells, &finite);
        bool barred = bricks_gather(g, &p, sd, bars->brick + s->n * cells, &finite);
        if (lit || barred)
            s->ids[s->n++] = id;
    }
    bars->n = s->n;
    return finite ? PVX_OK : PVX_ECORRUPT;
}

#define NOT_THERE UINT32_MAX

/* The brick of a voxel, and the voxel in it. */
static uint32_t brick_of(const struct pvp_grid *g, const uint32_t nb[3], int32_t index, size_t *in)
{
    uint32_t i = (uint32_t)index % g->n[0], j = (uint32_t)index / g->n[0] % g->n[1];
    uint32_t k = (uint32_t)index / g->n[0] / g->n[1];
    *in = ((size_t)(k % B) * B + j % B) * B + i % B;
    return (k / B * nb[1] + j / B) * nb[0] + i / B;
}

/* at [bricks of the grid], NOT_THERE: gets the place of each that has a voxel. */
static pvx_err find_bricks(struct vol_store *s, const struct pvp_grid *g, const uint32_t nb[3],
                           uint32_t all, const struct pvp_voxels *x, uint32_t *at)
{
    uint32_t n = 0;
    size_t in;
    for (uint32_t v = 0; v < x->n; v++)
        at[brick_of(g, nb, x->index[v], &in)] = 0;
    for (uint32_t id = 0; id < all; id++)
        if (at[id] != NOT_THERE)
            at[id] = n++;
    PVX_TRY(vol_store_grow(s, n, g->channels));
    s->n = n;
    for (uint32_t id = 0; id < all; id++)
        if (at[id] != NOT_THERE)
            s->ids[at[id]] = id;
    memset(s->brick, 0, (size_t)n * B * B * B * g->channels * sizeof *s->brick);
    return PVX_OK;
}

pvx_err vol_from_voxels(struct vol_store *s, const struct pvp_grid *g, const struct pvp_voxels *x)
{
    uint32_t nb[3], all = pvp_grid_bricks(g, nb), c = g->channels;
    uint32_t *at = malloc(all * sizeof *at);
    bool finite = true;
    s->n = 0;
    PVX_NEED(at);
    memset(at, 0xff, all * sizeof *at);
    pvx_err e = x->n > 0 ? find_bricks(s, g, nb, all, x, at) : PVX_OK;
    for (uint32_t v = 0; v < x->n && e == PVX_OK; v++) {
        size_t in;
        uint32_t b = at[brick_of(g, nb, x->index[v], &in)];
        float *to = s->brick + ((size_t)b * B * B * B + in) * c;
        for (uint32_t l = 0; l < c; l++) {
            to[l] = x->value[(size_t)v * (size_t)x->stride + l];
            finite &= isfinite(to[l]) != 0;
        }
    }
    free(at);
    return e == PVX_OK && !finite ? PVX_ECORRUPT : e;
}
