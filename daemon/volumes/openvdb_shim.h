/* openvdb_shim.h - what the OpenVDB module (lib/pyrovox/pyrovox-openvdb.so) offers, as plain C.
 *
 * The module is C++ and is loaded with dlopen by vdb_module.c on first use; it exports one function,
 * vol_vdb_module.  No exception crosses this border: every entry returns a pvx_err value as int and
 * puts a line into `err` when that is not 0.  Buffers that it gives are from malloc.
 * Files are bytes in memory.  The caller writes them, so that a full disk is noticed and files are whole.
 * Bricks are those of volumes.h.  A brick is a leaf of the tree, so nothing is ever dense.
 *
 * Index coordinates: voxel (i, j, k) is at (i, j, k); with y_up at (i, k, -1-j), which turns z up into y up
 * and leaves bricks on leaves.  World = origin + spacing * index, so a voxel's centre is on whole numbers.
 * Grids: `density`, luminance (Rec. 709), and with three channels `emission` of vectors, or with `split`
 * red, green, blue.  A voxel is active if some channel is not 0.  With error bars also `emission_sd`, the deviation of
 * `density`, and with three channels `rgb_sd`, vectors of the deviations of channels, or with `split` instead of both
 * red_sd, green_sd, blue_sd.  They are active where they are not 0.
 * A .vdb of temperatures also has `temperature` in kelvin, as floats, active where it is not 0.
 * .vdb is saved as half (values cut to +-65504), .nvdb as float.
 * The notes are a .vdb's metadata; NanoVDB has none, so there they are blind data of the first grid, called
 * VOL_NVDB_NOTES, in the same bytes as in a .vdb. */
#ifndef VOL_OPENVDB_SHIM_H
#define VOL_OPENVDB_SHIM_H
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define VOL_VDB_NOEXCEPT noexcept
#else
#define VOL_VDB_NOEXCEPT
#endif

#define VOL_VDB_VERSION   7
#define VOL_NVDB_NOTES    "pyrovox"
#define VOL_VDB_NOTES_MAX 64

enum vol_vdb_kind { VOL_VDB_TEXT, VOL_VDB_INT, VOL_VDB_REAL, VOL_VDB_VECTOR };
struct vol_vdb_note { /* one of the file's metadata */
    char key[24];
    int kind; /* enum vol_vdb_kind */
    int64_t i;
    double x[3]; /* VOL_VDB_REAL: the first */
    char text[64];
};

struct vol_vdb_bricks {
    uint32_t n[3], channels;
    int split, y_up;
    double origin[3], spacing[3]; /* of index coordinates, in the file's unit */
    uint32_t n_bricks;
    const uint32_t *ids; /* [n_bricks] ascending */
    const float *brick;  /* [n_bricks][8^3][channels] */
    const float *sd;     /* the same of the error bars; NULL: none */
    const float *kelvin; /* [n_bricks][8^3], only of .vdb; NULL: none */
    const struct vol_vdb_note *notes;
    size_t n_notes;
};
struct vol_vdb_bytes {
    void *data; /* malloc */
    size_t size;
};

struct vol_vdb {
    int version; /* VOL_VDB_VERSION */
    int (*write_vdb)(const struct vol_vdb_bricks *v, struct vol_vdb_bytes *out, char *err,
                     size_t err_size) VOL_VDB_NOEXCEPT;
    int (*write_nvdb)(const struct vol_vdb_bricks *v, struct vol_vdb_bytes *out, char *err,
                      size_t err_size) VOL_VDB_NOEXCEPT;
    /* Read the bricks of a file.  OpenVDB and NanoVDB trust what they read and may crash on damaged bytes.  So call
     * this in a process of its own and check its answer (vdb_child.c).  n, channels, split, y_up, origin and spacing
     * are input; ids, brick, sd and kelvin are output, from malloc.  PVX_EFORMAT: not such a file, or of other grids;
     * PVX_ECORRUPT: a value that is not finite, a leaf outside the grid; PVX_EUNSUP: a .vdb that another program
     * changed. */
    int (*read_vdb)(const void *bytes, size_t len, struct vol_vdb_bricks *v, char *err,
                    size_t err_size) VOL_VDB_NOEXCEPT;
    int (*read_nvdb)(const void *bytes, size_t len, struct vol_vdb_bricks *v, char *err,
                     size_t err_size) VOL_VDB_NOEXCEPT;
    /* The grids of a .nvdb as they lie in memory, one behind the other, without checksums.  nano_room: bytes that any
     * n_bricks bricks of the grid need at most.  nano_make: out has that size and is aligned to 32 bytes; *size:
     * bytes used.  nano_version: as in a grid's head. */
    uint32_t nano_version;
    size_t (*nano_room)(const struct vol_vdb_bricks *v) VOL_VDB_NOEXCEPT;
    int (*nano_make)(const struct vol_vdb_bricks *v, void *out, size_t *size, char *err,
                     size_t err_size) VOL_VDB_NOEXCEPT;
};

const struct vol_vdb *vol_vdb_module(void) VOL_VDB_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
