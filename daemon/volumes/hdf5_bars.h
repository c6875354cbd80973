/* hdf5_bars.h - error bars in an HDF5 file of volumes: /emission_sd, /emission_modes and their columns in /sets.
 * A file has them from the first set on that has bars. */
#ifndef VOL_HDF5_BARS_H
#define VOL_HDF5_BARS_H
#include "daemon/volumes/hdf5_pack.h"
#include "daemon/volumes/hdf5_unpack.h"

#define VOL_NO_BARS   UINT32_MAX /* in /sets/bars_doubt: this set has no bars */
#define VOL_BARS_COLS 6          /* the last three only where there are modes */
#define VOL_BARS_OWN  3

struct vol_bars_row {
    uint32_t doubt, chunks, modes, modes_chunks;
    uint64_t check, modes_check; /* 0 where there are none */
};
struct vol_bars_file {
    hid_t sd, modes; /* -1: not in this file */
    hid_t col[VOL_BARS_COLS];
    uint32_t n_modes; /* of a set, at most, so far */
    uint32_t most;    /* that a set may have, of a file that is written */
    bool sd_chunked, modes_chunked;
};
#define VOL_BARS_FILE         \
    {                         \
        .sd = -1, .modes = -1 \
    }

/* Makes what is missing for these bars in a file that is not in SWMR mode; the n_sets rows before say "none". */
bool vol_bars_make(hid_t file, const struct vol_head *h, const struct vol_bars *bars,
                   uint64_t n_sets, struct vol_bars_file *b);
/* Opens it again after the file was closed. */
bool vol_bars_again(hid_t file, struct vol_bars_file *b);
bool vol_bars_reach(const struct vol_bars_file *b, const struct pvp_grid *g, uint64_t sets);
bool vol_bars_append(const struct vol_bars_file *b, uint64_t n, const struct vol_bars_row *r);
/* Makes the columns for n rows in a file that is written at once. */
bool vol_bars_columns(hid_t file, const struct vol_bars_row *rows, uint64_t n, bool modes);

/* Of a file that vol_hdf5_reader opened: the row of a set, and what it has. */
bool vol_hdf5_bars_row(void *self, uint64_t k, struct vol_bars_row *r);
void vol_hdf5_has_bars(const void *self, bool *sd, uint32_t *modes);

/* Opens those of a file that is read; *said becomes the number of sets that all of them have.  NULL: good, else what is
 * wrong. */
const char *vol_bars_open(hid_t file, const char *path, uint64_t bytes, const struct pvp_grid *g,
                          struct vol_bars_file *b, uint64_t *said);
bool vol_bars_row(const struct vol_bars_file *b, uint64_t k, struct vol_bars_row *r);
/* Reads the bars of set k as planes 1 and following of u.  `keep`: the modes too; without it they are not read, or with
 * `look` are only checked. */
PVX_MUST_CHECK pvx_err vol_bars_read(struct vol_unpacker *u, const struct vol_bars_file *b,
                                     const struct vol_bars_row *r, uint64_t k, uint64_t row_check,
                                     bool keep, bool look);
/* `check` and `modes_check` of a row, from the hashes of the chunks; seeded with the row's own check. */
uint64_t vol_bars_check(uint64_t chunks_hash, uint32_t number, uint32_t chunks);
#endif
