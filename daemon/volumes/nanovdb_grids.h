/* nanovdb_grids.h - NanoVDB grids made directly from bricks, which have the size of NanoVDB's leaves; C++, inside the
 * OpenVDB module.
 *
 * No tree is built before: NanoVDB's tables are filled in place (a file's buffer, shared memory).  Nodes have the
 * order and the statistics of openToNanoVDB (for vectors: of the square of their length); the checksum is empty.
 * Grids and index coordinates: openvdb_shim.h.  Grids lie one behind the other, each with its index and their count.
 * Throws std::bad_alloc. */
#ifndef VOL_NANOVDB_GRIDS_H
#define VOL_NANOVDB_GRIDS_H
#include <string>

#include "daemon/volumes/openvdb_shim.h"

namespace vol
{

constexpr int SIDE = 8, CELLS = SIDE * SIDE * SIDE;

/* Index of a brick's voxel (i, j, k) in its leaf, where z is fastest. */
inline unsigned leaf_cell(int i, int j, int k, bool y_up)
{
    return static_cast<unsigned>(y_up ? i << 6 | k << 3 | (SIDE - 1 - j) : i << 6 | j << 3 | k);
}

struct Index {
    int x, y, z;
};
inline Index leaf_origin(const vol_vdb_bricks &v, uint32_t id)
{
    const uint32_t nx = (v.n[0] + SIDE - 1) / SIDE, ny = (v.n[1] + SIDE - 1) / SIDE;
    const int x = SIDE * static_cast<int>(id % nx), y = SIDE * static_cast<int>(id / nx % ny),
              z = SIDE * static_cast<int>(id / nx / ny);
    return v.y_up ? Index{x, z, -SIDE - y} : Index{x, y, z};
}

/* The value that a scalar grid stores for a voxel of three channels. */
inline float luminance(float red, float green, float blue)
{
    return 0.2126f * red + 0.7152f * green + 0.0722f * blue;
}

/* Bytes that nano_make writes at most, for any v.n_bricks bricks of the grid; with error bars if v has some. */
size_t nano_room(const vol_vdb_bricks &v, size_t notes);
/* Writes all grids of v to `out`, which is aligned to 32 bytes and has nano_room's size.  Returns the bytes written.
 * v.n: at most 4096. */
size_t nano_make(const vol_vdb_bricks &v, const std::string &notes, void *out);

} // namespace vol
#endif
