/* hdf5_unpack.h - the chunks of a set read back into bricks, for hdf5_read.c: the inverse of hdf5_pack.h.
 *
 * A set has planes: its emission, the deviations of its bars, each of their modes.  All planes have the same bricks:
 * those in which any of them is not 0.
 * Threads: one at a time. */
#ifndef VOL_HDF5_UNPACK_H
#define VOL_HDF5_UNPACK_H
#include "daemon/volumes/hdf5.h"

struct vol_unpacker {
    struct pvp_grid grid;
    struct vol_tiles t;
    uint32_t nb[3], n_bricks;
    size_t cells; /* floats of a brick */
    float *chunk;
    uint32_t *brick_at; /* [n_bricks] place in raw + 1, 0 = none yet */
    float *raw;         /* [planes][room][cells], bricks in the order in which they were met */
    size_t raw_floats;  /* that there is room for */
    uint32_t planes, room, met;
    /* what came of it: */
    uint32_t n, *ids; /* ascending */
    float *brick;     /* [planes][n][cells] */
    size_t floats, ids_room;
};
PVX_MUST_CHECK pvx_err vol_unpacker_open(struct vol_unpacker *u, const struct pvp_grid *g);
void vol_unpacker_free(struct vol_unpacker *u);
/* Begins a set of that many planes, with at most `chunks` chunks in all. */
PVX_MUST_CHECK pvx_err vol_unpack_begin(struct vol_unpacker *u, uint32_t planes, uint64_t chunks);

/* Where a plane lies. */
struct vol_plane {
    hid_t from;
    bool chunked; /* as the recorder does it; else another program wrote it anew */
    uint64_t set;
    int mode;        /* -1: the dataset has no modes */
    uint32_t number; /* of the plane; UINT32_MAX: its values are only hashed */
    bool not_below;  /* 0: a value below makes it corrupt */
};
/* Reads one plane.  *seed, *found: vol_hash and number of its chunks are added.  PVX_ECORRUPT: a value cannot be read or
 * is not finite, or more chunks than `most`. */
PVX_MUST_CHECK pvx_err vol_unpack_plane(struct vol_unpacker *u, const struct vol_plane *p,
                                        uint32_t first, uint32_t most, uint64_t *seed,
                                        uint32_t *found);
/* Sorts the bricks by id. */
PVX_MUST_CHECK pvx_err vol_unpack_end(struct vol_unpacker *u);
#endif
