#include "daemon/volumes/hdf5_pack.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>
#include <zlib.h>

#include "base/cpu.h"
#include "base/mem.h"

#define LEVEL    1  /* of deflate: higher ones cost several times the time for a few per cent */
#define AS_IT_IS 3u /* filter mask: neither shuffled nor deflated */
#define FLOATS   ((size_t)VOL_CHUNK * VOL_CHUNK * VOL_CHUNK * 3)
#define B        PVP_BRICK
#define NO_BRICK UINT32_MAX
#define THREADS  4

/* The bricks of chunk `id` as floats [side z][side y][side x][c]. */
static void assemble(const struct vol_packer *w, uint32_t id, float *out)
{
    const uint32_t *s = w->t.side, c = w->grid.channels;
    const uint32_t at[3] = {id % w->t.n[0] * s[0], id / w->t.n[0] % w->t.n[1] * s[1],
                            id / w->t.n[0] / w->t.n[1] * s[2]};
    memset(out, 0, w->t.floats * sizeof *out);
    for (uint32_t k = 0; k < s[2] && at[2] + k < w->grid.n[2]; k++)
        for (uint32_t j = 0; j < s[1] && at[1] + j < w->grid.n[1]; j++)
            for (uint32_t i = 0; i < s[0] && at[0] + i < w->grid.n[0]; i += B) {
                uint32_t x = at[0] + i, y = at[1] + j, z = at[2] + k;
                uint32_t b = w->brick_at[(z / B * w->nb[1] + y / B) * w->nb[0] + x / B];
                if (b == NO_BRICK)
                    continue;
                size_t row = ((size_t)b * B * B + z % B * B + y % B) * B;
                uint32_t in = s[0] - i < B ? s[0] - i : B;
                memcpy(out + (((size_t)k * s[1] + j) * s[0] + i) * c, w->brick + row * c,
                       (size_t)in * c * sizeof *out);
            }
}

/* HDF5's shuffle filter: first bytes of all floats, then the second ones, ... */
static void shuffle(const float *in, size_t n, unsigned char *out)
{
    const unsigned char *p = (const unsigned char *)in;
    for (size_t byte = 0; byte < sizeof *in; byte++)
        for (size_t i = 0; i < n; i++)
            out[byte * n + i] = p[i * sizeof *in + byte];
}

static void hdf5_pack_one(void *ctx, size_t task)
{
    struct vol_packer *w = ctx;
    float floats[FLOATS];
    unsigned char shuffled[FLOATS * sizeof(float)], *to = w->packed + task * w->bound;
    size_t n = w->t.floats, bytes = n * sizeof *floats;
    assemble(w, w->chunk[task], floats);
    w->hash[task] = XXH3_64bits(floats, bytes);
    uLongf packed = w->bound;
    if (!w->hurry) {
        shuffle(floats, n, shuffled);
        if (compress2(to, &packed, shuffled, bytes, LEVEL) == Z_OK && packed < bytes) {
            w->size[task] = packed;
            w->mask[task] = 0;
            return;
        }
    }
    memcpy(to, floats, bytes);
    w->size[task] = bytes;
    w->mask[task] = AS_IT_IS;
}

static pvx_err hdf5_pack_grow(struct vol_packer *w, uint32_t chunks)
{
    if (chunks <= w->packed_room)
        return PVX_OK;
    free(w->packed);
    w->packed_room = 0;
    w->packed = malloc(chunks * w->bound);
    if (w->packed == NULL)
        return PVX_ENOMEM;
    w->packed_room = chunks;
    return PVX_OK;
}

/* Find the chunks that have values and the places of their bricks. */
static void hdf5_pack_mark(struct vol_packer *w, uint32_t n, const uint32_t *ids)
{
    size_t cells = (size_t)B * B * B * w->grid.channels;
    memset(w->wanted, 0, w->t.all);
    for (uint32_t b = 0; b < n; b++) {
        uint32_t id = ids[b];
        if (vol_all_zero(w->brick + b * cells, cells))
            continue;
        w->brick_at[id] = b;
        uint32_t x = id % w->nb[0] * B / w->t.side[0],
                 y = id / w->nb[0] % w->nb[1] * B / w->t.side[1];
        uint32_t z = id / w->nb[0] / w->nb[1] * B / w->t.side[2];
        w->wanted[(z * w->t.n[1] + y) * w->t.n[0] + x] = 1;
    }
    w->n_chunks = 0;
    for (uint32_t k = 0; k < w->t.all; k++)
        if (w->wanted[k])
            w->chunk[w->n_chunks++] = k;
}

pvx_err vol_pack(struct vol_packer *w, uint32_t n, const uint32_t *ids, const float *brick,
                 uint64_t *bytes)
{
    w->brick = brick;
    *bytes = 0;
    hdf5_pack_mark(w, n, ids);
    pvx_err e = hdf5_pack_grow(w, w->n_chunks);
    if (e == PVX_OK)
        pvx_pool_run(w->pool, w->n_chunks, hdf5_pack_one, w);
    for (uint32_t b = 0; b < n; b++)
        w->brick_at[ids[b]] = NO_BRICK;
    for (uint32_t k = 0; k < w->n_chunks && e == PVX_OK; k++)
        *bytes += w->size[k];
    return e;
}

bool vol_pack_put(const struct vol_packer *w, hid_t to, uint64_t set, int mode)
{
    for (uint32_t k = 0; k < w->n_chunks; k++) {
        uint32_t id = w->chunk[k];
        hsize_t at[VOL_RANK + 1] = {set, mode >= 0 ? (hsize_t)mode : 0};
        hsize_t *zyx = at + (mode >= 0 ? 2 : 1);
        zyx[0] = (hsize_t)(id / w->t.n[0] / w->t.n[1]) * w->t.side[2];
        zyx[1] = (hsize_t)(id / w->t.n[0] % w->t.n[1]) * w->t.side[1];
        zyx[2] = (hsize_t)(id % w->t.n[0]) * w->t.side[0];
        zyx[3] = 0;
        if (H5Dwrite_chunk(to, H5P_DEFAULT, w->mask[k], at, w->size[k], w->packed + k * w->bound) <
            0)
            return false;
    }
    return true;
}

uint64_t vol_pack_hash(const struct vol_packer *w, uint64_t seed, uint32_t first)
{
    for (uint32_t k = 0; k < w->n_chunks; k++)
        seed = vol_hash(seed, first + w->chunk[k], w->hash[k]);
    return seed;
}

hid_t vol_pack_make(hid_t file, const char *name, const struct pvp_grid *g, uint32_t most_modes)
{
    const struct vol_tiles t = vol_tiles(g);
    hsize_t now[VOL_RANK + 1] = {0}, most[VOL_RANK + 1], chunk[VOL_RANK + 1] = {1, 1};
    const int lead = most_modes > 0 ? 2 : 1;
    for (int a = 0; a < 3; a++) {
        now[lead + a] = g->n[2 - a];
        chunk[lead + a] = t.side[2 - a];
    }
    now[lead + 3] = chunk[lead + 3] = g->channels;
    memcpy(most, now, sizeof most);
    most[0] = H5S_UNLIMITED;
    if (most_modes > 0)
        most[1] = most_modes;
    hid_t space = H5Screate_simple(lead + 4, now, most), p = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(p, lead + 4, chunk);
    H5Pset_shuffle(p);
    H5Pset_deflate(p, LEVEL);
    hid_t s = name != NULL
                  ? H5Dcreate2(file, name, H5T_IEEE_F32LE, space, H5P_DEFAULT, p, H5P_DEFAULT)
                  : H5Dcreate_anon(file, H5T_IEEE_F32LE, space, p, H5P_DEFAULT);
    H5Pclose(p);
    H5Sclose(space);
    return s;
}

void vol_packer_free(struct vol_packer *w)
{
    pvx_pool_free(&w->pool);
    free(w->brick_at);
    free(w->chunk);
    free(w->packed);
    free(w->size);
    free(w->mask);
    free(w->hash);
    free(w->wanted);
}

pvx_err vol_packer_open(struct vol_packer *w, const struct pvp_grid *g)
{
    unsigned cpus = pvx_cpu_count(), threads = cpus < THREADS ? cpus : THREADS;
    w->grid = *g;
    w->t = vol_tiles(g);
    w->bound = compressBound(w->t.floats * sizeof(float));
    w->n_bricks = pvp_grid_bricks(&w->grid, w->nb);
    w->brick_at = malloc(w->n_bricks * sizeof *w->brick_at);
    w->chunk = malloc(w->t.all * sizeof *w->chunk);
    w->size = malloc(w->t.all * sizeof *w->size);
    w->mask = malloc(w->t.all * sizeof *w->mask);
    w->hash = malloc(w->t.all * sizeof *w->hash);
    w->wanted = malloc(w->t.all);
    for (uint32_t b = 0; b < w->n_bricks && w->brick_at != NULL; b++)
        w->brick_at[b] = NO_BRICK;
    if (w->brick_at == NULL || w->chunk == NULL || w->size == NULL || w->mask == NULL ||
        w->hash == NULL || w->wanted == NULL)
        return PVX_ENOMEM;
    return pvx_pool_new(threads, "vol-pack", &w->pool);
}
