#include "daemon/volumes/hdf5_unpack.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "base/mem.h"

#define B PVP_BRICK

pvx_err vol_unpacker_open(struct vol_unpacker *u, const struct pvp_grid *g)
{
    u->grid = *g;
    u->t = vol_tiles(g);
    u->n_bricks = pvp_grid_bricks(g, u->nb);
    u->cells = (size_t)B * B * B * g->channels;
    u->chunk = malloc(u->t.floats * sizeof *u->chunk);
    u->brick_at = malloc(u->n_bricks * sizeof *u->brick_at);
    return u->chunk != NULL && u->brick_at != NULL ? PVX_OK : PVX_ENOMEM;
}

void vol_unpacker_free(struct vol_unpacker *u)
{
    free(u->chunk);
    free(u->brick_at);
    free(u->raw);
    free(u->ids);
    free(u->brick);
}

static pvx_err unpack_room(float **at, size_t *have, size_t want)
{
    if (*at != NULL && want <= *have)
        return PVX_OK;
    free(*at);
    *have = 0;
    *at = malloc((want > 0 ? want : 1) * sizeof **at);
    PVX_NEED(*at);
    *have = want;
    return PVX_OK;
}

pvx_err vol_unpack_begin(struct vol_unpacker *u, uint32_t planes, uint64_t chunks)
{
    memset(u->brick_at, 0, u->n_bricks * sizeof *u->brick_at);
    u->planes = planes;
    u->met = 0;
    /* a chunk has at most 8 bricks */
    u->room = chunks < u->n_bricks / 8 ? 8 * (uint32_t)chunks : u->n_bricks;
    return unpack_room(&u->raw, &u->raw_floats, (size_t)planes * u->room * u->cells);
}

static bool unpack_chunk(struct vol_unpacker *u, const struct vol_plane *p, const uint32_t at[3])
{
    const struct pvp_grid *g = &u->grid;
    const int lead = p->mode >= 0 ? 2 : 1;
    hsize_t from[VOL_RANK + 1] = {p->set, p->mode >= 0 ? (hsize_t)p->mode : 0};
    hsize_t n[VOL_RANK + 1] = {1, 1}, side[VOL_RANK + 1] = {1, 1};
    const hsize_t zero[VOL_RANK + 1] = {0};
    for (int a = 0; a < 3; a++) {
        hsize_t left = g->n[2 - a] - at[2 - a];
        from[lead + a] = at[2 - a];
        side[lead + a] = u->t.side[2 - a];
        n[lead + a] = left < side[lead + a] ? left : side[lead + a];
    }
    from[lead + 3] = 0;
    n[lead + 3] = side[lead + 3] = g->channels;
    memset(u->chunk, 0, u->t.floats * sizeof *u->chunk);
    hid_t space = H5Dget_space(p->from), mem = H5Screate_simple(lead + 4, side, NULL);
    bool ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, from, NULL, n, NULL) >= 0 &&
              H5Sselect_hyperslab(mem, H5S_SELECT_SET, zero, NULL, n, NULL) >= 0 &&
              H5Dread(p->from, H5T_NATIVE_FLOAT, mem, space, H5P_DEFAULT, u->chunk) >= 0;
    H5Sclose(mem);
    H5Sclose(space);
    return ok;
}

static float *unpack_brick(struct vol_unpacker *u, uint32_t plane, uint32_t slot)
{
    return u->raw + ((size_t)plane * u->room + slot) * u->cells;
}

/* The place of the brick in a plane.  It is zeroed in all planes when it is met first. */
static float *unpack_meet(struct vol_unpacker *u, uint32_t plane, uint32_t id)
{
    if (u->brick_at[id] == 0) {
        for (uint32_t k = 0; k < u->planes; k++)
            memset(unpack_brick(u, k, u->met), 0, u->cells * sizeof *u->raw);
        u->brick_at[id] = ++u->met;
    }
    return unpack_brick(u, plane, u->brick_at[id] - 1);
}

/* Put the chunk's values that are not 0 into bricks; false when one is not what the plane may hold. */
static bool unpack_scatter(struct vol_unpacker *u, const struct vol_plane *p, const uint32_t at[3])
{
    const struct pvp_grid *g = &u->grid;
    const uint32_t *s = u->t.side, c = g->channels;
    for (uint32_t k = 0; k < s[2] && at[2] + k < g->n[2]; k++)
        for (uint32_t j = 0; j < s[1] && at[1] + j < g->n[1]; j++)
            for (uint32_t i = 0; i < s[0] && at[0] + i < g->n[0]; i++)
                for (uint32_t v = 0; v < c; v++) {
                    float x = u->chunk[(((size_t)k * s[1] + j) * s[0] + i) * c + v];
                    if (x == 0)
                        continue;
                    if (!isfinite(x) || (p->not_below && x < 0))
                        return false;
                    if (p->number == UINT32_MAX)
                        continue;
                    const uint32_t q[3] = {at[0] + i, at[1] + j, at[2] + k};
                    uint32_t id = (q[2] / B * u->nb[1] + q[1] / B) * u->nb[0] + q[0] / B;
                    if (u->brick_at[id] == 0 && u->met >= u->room)
                        return false;
                    unpack_meet(u, p->number,
                                id)[((q[2] % B * B + q[1] % B) * B + q[0] % B) * c + v] = x;
                }
    return true;
}

static bool unpack_is_there(const struct vol_plane *p, const uint32_t at[3])
{
    const int lead = p->mode >= 0 ? 2 : 1;
    hsize_t from[VOL_RANK + 1] = {p->set, p->mode >= 0 ? (hsize_t)p->mode : 0}, bytes = 0;
    for (int a = 0; a < 3; a++)
        from[lead + a] = at[2 - a];
    from[lead + 3] = 0;
    return !p->chunked || (H5Dget_chunk_storage_size(p->from, from, &bytes) >= 0 && bytes > 0);
}

pvx_err vol_unpack_plane(struct vol_unpacker *u, const struct vol_plane *p, uint32_t first,
                         uint32_t most, uint64_t *seed, uint32_t *found)
{
    for (uint32_t id = 0; id < u->t.all; id++) {
        const uint32_t at[3] = {id % u->t.n[0] * u->t.side[0],
                                id / u->t.n[0] % u->t.n[1] * u->t.side[1],
                                id / u->t.n[0] / u->t.n[1] * u->t.side[2]};
        if (!unpack_is_there(p, at))
            continue;
        if (!unpack_chunk(u, p, at))
            return PVX_ECORRUPT;
        /* h5repack and h5copy also write the chunks that were not there, as zeros */
        if (vol_all_zero(u->chunk, u->t.floats))
            continue;
        if (++*found > most || !unpack_scatter(u, p, at))
            return PVX_ECORRUPT;
        *seed = vol_hash(*seed, first + id, XXH3_64bits(u->chunk, u->t.floats * sizeof *u->chunk));
    }
    return PVX_OK;
}

/* Ids ascend along whole rows of bricks, but chunks do not. */
pvx_err vol_unpack_end(struct vol_unpacker *u)
{
    u->n = 0;
    PVX_TRY(unpack_room(&u->brick, &u->floats, (size_t)u->planes * u->met * u->cells));
    if (u->met > u->ids_room || u->ids == NULL) {
        free(u->ids);
        u->ids = malloc(u->met > 0 ? u->met * sizeof *u->ids : sizeof *u->ids);
        u->ids_room = u->ids != NULL ? u->met : 0;
        PVX_NEED(u->ids);
    }
    for (uint32_t id = 0; id < u->n_bricks; id++) {
        if (u->brick_at[id] == 0)
            continue;
        for (uint32_t k = 0; k < u->planes; k++)
            memcpy(u->brick + ((size_t)k * u->met + u->n) * u->cells,
                   unpack_brick(u, k, u->brick_at[id] - 1), u->cells * sizeof *u->brick);
        u->ids[u->n++] = id;
    }
    return PVX_OK;
}
