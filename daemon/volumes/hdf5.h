/* hdf5.h - the layout of daemon/VOLUMES.md, for writer (hdf5_write.c) and reader (hdf5_read.c). */
#ifndef VOL_HDF5_H
#define VOL_HDF5_H
#include <hdf5.h>
#include "capture/take/h5.h"
#include "daemon/volumes/bricks.h"

#define VOL_FORMAT   "pyrovox volumes"
#define VOL_VERSION  1
#define VOL_CHUNK    16  /* voxels along a side of a chunk of /emission */
#define VOL_ROWS     64  /* sets per chunk of a column */
#define VOL_ALIGN    512 /* a page would cost a third of a file of small volumes */
#define VOL_RANK     5
#define VOL_COLUMNS  24
#define VOL_GAP_COLS 4

/* One set's row of the columns in /sets. */
struct vol_row {
    uint64_t number, camera_mask, entries, check;
    double time, rel_residual;
    int64_t t_exposure_ns, t_publish_ns, spread_ns, latency_ns;
    int64_t photometry_ns, hull_ns, restrict_ns, solve_ns, total_ns;
    uint32_t cameras_present, status, iterations, active_voxels, active_rays, chunks;
    uint8_t clamped, sample;
    char solver[16];
};

struct vol_column {
    const char *name;
    hid_t type; /* a library constant, except for the solver's name (vol_columns_done) */
    size_t offset;
};
/* The columns.  `check` and `number` are last, as a reader of a growing file counts the rows of `number`.
 * vol_columns_done frees what they own. */
void vol_columns(struct vol_column out[VOL_COLUMNS]);
void vol_columns_done(struct vol_column c[VOL_COLUMNS]);
extern const char *const vol_gap_columns[VOL_GAP_COLS]; /* why, set_first, set_last, volumes: u64 */

/* Sides of a chunk, which is never larger than the grid, and chunks along x, y, z. */
struct vol_tiles {
    uint32_t side[3], n[3], all;
    size_t floats; /* of a chunk */
};
struct vol_tiles vol_tiles(const struct pvp_grid *g);
bool vol_all_zero(const float *v, size_t n);
/* Chained hash of a set's chunks: adds chunk `id`, whose floats hash to h, to the hash `before` (0 for the first). */
uint64_t vol_hash(uint64_t before, uint32_t id, uint64_t h);
/* XXH3-64 of a row without its `check`, seeded with vol_hash of its chunks. */
uint64_t vol_row_check(const struct vol_column c[VOL_COLUMNS], const struct vol_row *r,
                       uint64_t seed);
/* Reads the first n rows of a file that vol_hdf5_reader opened, as they are stored; `check` covers the chunks too. */
bool vol_hdf5_rows(void *self, uint64_t n, struct vol_row *rows);
/* Whether a dataset (/emission, say) is there and has filters, as the recorder writes it.  That of a joined file has none, nor has what
 * `h5repack -f NONE` made.  It is not opened, so the place of its data is not looked at. */
bool vol_hdf5_filtered(hid_t file, const char *name);
/* The number of a filter of a dataset that this HDF5 lacks, or -1.  Programs bring their own, as h5py its lzf. */
int vol_hdf5_lacks(hid_t set);
/* Whether an /emission without filters can be opened.  The mapping of a joined file lies in the heap, which has no
 * checksum, and libhdf5 (1.10.8) trusts it: where the heap is damaged, it searches for ever, or past the end. */
bool vol_hdf5_heaps_end(const char *path, uint64_t bytes);
#define VOL_HEAPS_MOST (UINT64_C(1) << 30) /* bytes: more than any joined file has */
/* An attribute of three finite numbers, as origin and spacing. */
bool vol_hdf5_triple(hid_t at, const char *name, double out[3]);
/* Attributes, rig and configuration of a new file; not closed yet. */
bool vol_hdf5_head(hid_t file, const struct vol_head *h);
/* Axes, units and the groups of NeXus, once /emission and /sets are there. */
bool vol_hdf5_nexus(hid_t file, const struct vol_head *h);
/* Axes and units of the dataset that is or becomes /emission_sd, and its place in NeXus: the errors of the signal. */
bool vol_hdf5_errors(hid_t file, hid_t sd, const struct vol_head *h);
/* A new group whose links lie in one piece: a link that is added is there or is not. */
hid_t vol_hdf5_group(hid_t at, const char *name);
/* The group that viewers of NeXus show by themselves, when the file is complete: one channel beside the other. */
bool vol_hdf5_flame(hid_t file, const struct pvp_grid *g, uint64_t sets);
/* The group that ParaView reads, on the same data of `sets` volumes.  Call it when the file is complete. */
bool vol_hdf5_vtk(hid_t file, const struct pvp_grid *g, uint64_t sets);
#endif
