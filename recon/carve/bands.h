/* bands.h - pictures cut into bands of rows, the unit of parallel work on them: enough tasks for the cores, even with
 * few cameras.  The cut depends on the pictures' height alone.
 * Private to recon/carve. */
#ifndef REC_BANDS_H
#define REC_BANDS_H
#include <stddef.h>
#include <stdint.h>
#include "recon/geom/rig.h"

#define REC_BAND_ROWS 16 /* a multiple of the blocks that noise is measured in (photo_pass.h) */

static inline size_t rec_band_count(int32_t rows)
{
    return (size_t)((rows + REC_BAND_ROWS - 1) / REC_BAND_ROWS);
}

/* The bands of several pictures, one picture after the other. */
struct rec_bands {
    size_t pictures, first[REC_MAX_CAMERAS + 1];
};
static inline void rec_bands_add(struct rec_bands *b, int32_t rows)
{
    b->first[b->pictures + 1] = b->first[b->pictures] + rec_band_count(rows);
    b->pictures++;
}
static inline size_t rec_bands_all(const struct rec_bands *b)
{
    return b->first[b->pictures];
}
/* The picture that a task belongs to; *band: which of its bands. */
static inline size_t rec_bands_find(const struct rec_bands *b, size_t task, int32_t *band)
{
    size_t c = 0;
    while (task >= b->first[c + 1])
        c++;
    *band = (int32_t)(task - b->first[c]);
    return c;
}

/* Rows [*y0, *y1) of a band. */
static inline void rec_band_rows(int32_t band, int32_t rows, int32_t *y0, int32_t *y1)
{
    *y0 = band * REC_BAND_ROWS;
    *y1 = *y0 + REC_BAND_ROWS < rows ? *y0 + REC_BAND_ROWS : rows;
}

#endif
