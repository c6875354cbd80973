/* columns.h - the entries of an image, traced row by row in bands, sorted into columns.  Not for other modules.
 *   count    strips of bands with about equal numbers of entries: entries per column
 *   sum      colptr, and where each strip's entries of a column start
 *   fill     the strips again: every entry to its column
 * No two tasks write to one place, and the rows of a column ascend because strips and bins do, so the result does not
 * depend on how many bands, strips or threads there are. */
#ifndef REC_COLUMNS_H
#define REC_COLUMNS_H
#include "recon/matrix/entries.h"

#define REC_BANDS_MAX 256
#define REC_ENTRY     (sizeof(uint32_t) + sizeof(uint8_t)) /* bytes */

/* Entries of some rows of an image, row by row. */
struct rec_band {
    uint32_t *col;
    uint8_t *val;
    size_t n, room;
    int32_t row0; /* its first row of bins; it ends where the next begins */
};
/* Room for `more` entries.  False: out of memory. */
bool rec_band_grow(struct rec_band *b, size_t more);

struct rec_band_rows {
    struct rec_band band[REC_BANDS_MAX + 1]; /* band[bands] has only its row0 */
    size_t bands;
    int32_t bw;
    uint32_t *bin_n; /* [rows] entries of each bin */
};
uint64_t rec_band_entries(const struct rec_band_rows *r);
/* Frees all but bin_n, which belongs to the caller. */
void rec_band_rows_free(struct rec_band_rows *r);

/* Makes columns 0..N-1 in *out: colptr [N+1], row, val.  At most 2^32-1 entries.  After PVX_ENOMEM the caller frees
 * what *out has. */
PVX_MUST_CHECK pvx_err rec_columns(const struct rec_band_rows *rows, size_t N, pvx_pool *pool,
                                   struct rec_entries *out);

#endif
