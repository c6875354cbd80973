/* hdf5_pack.h - the chunks of a set's values, packed by a pool, for hdf5_write.c and hdf5_bars.c.
 * Threads: one at a time. */
#ifndef VOL_HDF5_PACK_H
#define VOL_HDF5_PACK_H
#include "base/pool.h"
#include "daemon/volumes/hdf5.h"

struct vol_packer {
    struct pvp_grid grid;
    struct vol_tiles t;
    uint32_t nb[3], n_bricks;
    pvx_pool *pool;
    bool hurry; /* do not compress */
    /* the values at hand */
    const float *brick;
    uint32_t *brick_at; /* [n_bricks of the grid], UINT32_MAX = not there */
    uint32_t *chunk;    /* [n_chunks] ids, ascending */
    uint32_t n_chunks;
    unsigned char *packed; /* [n_chunks][bound] */
    uint32_t packed_room;
    size_t bound;
    size_t *size;          /* [n_chunks] */
    unsigned *mask;        /* [n_chunks] filters that were left out */
    uint64_t *hash;        /* [n_chunks] */
    unsigned char *wanted; /* [chunks of the grid] */
};
/* {0} is empty; vol_packer_free frees what vol_packer_open made, also when it failed. */
PVX_MUST_CHECK pvx_err vol_packer_open(struct vol_packer *p, const struct pvp_grid *g);
void vol_packer_free(struct vol_packer *p);
/* Packs the chunks of `brick`, [n][8^3][channels], that are not all 0.  *bytes: what they take. */
PVX_MUST_CHECK pvx_err vol_pack(struct vol_packer *p, uint32_t n, const uint32_t *ids,
                                const float *brick, uint64_t *bytes);
/* Writes them to `set` of a dataset [set][z][y][x][c], or with mode >= 0 to that mode of [set][mode][z][y][x][c]. */
bool vol_pack_put(const struct vol_packer *p, hid_t to, uint64_t set, int mode);
/* Adds their hashes; `first` is added to their ids. */
uint64_t vol_pack_hash(const struct vol_packer *p, uint64_t seed, uint32_t first);
/* A new dataset of that shape, which grows in sets, and in modes up to `most`; 0: without that dimension.  name NULL: not
 * linked yet. */
hid_t vol_pack_make(hid_t file, const char *name, const struct pvp_grid *g, uint32_t most);
#endif
