/* windows.h - a sparse matrix as windows of pixels: a window is the part of a voxel's column in one image.
 *
 *     column q = sum over cameras c of  unit * w[q][c][r][k]  at row  at[q][c] + r*pitch[c] + k     (1)
 *     r in [0,high), k in [0,wide)
 * A voxel touches a few neighbouring bins of each camera.  Their numbers follow from the first one, so only that
 * number and a byte for each bin are stored.  Bins that do not fit into a column's window of a camera are in `more`:
 * further windows, ascending by column.
 * Rows are the bins of all images, one after the other.  A vector over them has room for `room` bins; those from
 * `nowhere` on are always 0.  A window that does not exist has its place at `nowhere`.  One at the border of a tiny
 * image may hang over its end; its weights are 0 there.
 * Columns q and q+1 that have all windows at the same places are multiplied together where that is faster.  The
 * matrix is built so that most neighbours do (matrix/windows.c).  The sums of a column and of a bin are the same
 * either way.
 * Shapes: 2x2, 2x4, 3x4, 4x4 (rows x columns).  Slots are the cameras, rounded up to whole groups of 4. */
#ifndef REC_WINDOWS_H
#define REC_WINDOWS_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define REC_SLOT_GROUP  4
#define REC_SLOTS_MAX   64
#define REC_WINDOW_MAX  16 /* weights */
#define REC_WINDOWS_PAD 16 /* bytes that may be read after the last weight */

struct rec_more {
    uint32_t column, at;
    uint32_t slot;
    uint8_t w[REC_WINDOW_MAX]; /* [high*wide], then 0 */
};

struct rec_windows {
    int32_t slots, high, wide;
    int32_t pitch[REC_SLOTS_MAX]; /* of each slot: bins in a row of its camera's image */
    uint32_t nowhere, room;
    float unit;
    uint32_t *at;          /* [columns][slots] */
    uint8_t *w;            /* [columns][slots][high*wide], and REC_WINDOWS_PAD bytes */
    uint32_t n_more;       /* of all columns */
    struct rec_more *more; /* ascending by column */
};

static inline size_t rec_window_size(const struct rec_windows *m)
{
    return (size_t)m->high * (size_t)m->wide;
}

/* Products with the windows of columns [q0,q1) and slots [s0,s1), without `more`; x [columns][cs],
 * y [room][cs].
 *   adjoint: x[q] = unit * sum of w y        scatter: y += w x[q]
 * Unit multiplies a finished sum, once, and not x: small x would lose bits that the sum keeps.
 * cs 1, or 4 and then 16-byte aligned.  A fast loop needs s0 and s1 to be multiples of
 * REC_SLOT_GROUP. */
struct rec_slots {
    int32_t s0, s1;
};
typedef void (*rec_windows_adjoint_fn)(const struct rec_windows *m, struct rec_slots s, int32_t q0,
                                       int32_t q1, const float *y, float *x);
typedef void (*rec_windows_scatter_fn)(const struct rec_windows *m, struct rec_slots s, int32_t q0,
                                       int32_t q1, const float *x, float *y);
/* The same with further windows, for both products; they add to `out`. */
struct rec_more_run {
    const struct rec_more *at, *end;
};
typedef void (*rec_windows_more_fn)(const struct rec_windows *m, struct rec_slots s,
                                    struct rec_more_run run, const float *in, float *out);
static inline bool rec_more_is_of(const struct rec_more *k, struct rec_slots s)
{
    return (int32_t)k->slot >= s.s0 && (int32_t)k->slot < s.s1;
}
/* The first of a run, which ascends by column, that is of this column or a later one; run.end if none is. */
static inline const struct rec_more *rec_more_from(struct rec_more_run run, uint32_t column)
{
    while (run.at < run.end) {
        const struct rec_more *mid = run.at + (run.end - run.at) / 2;
        if (mid->column < column)
            run.at = mid + 1;
        else
            run.end = mid;
    }
    return run.at;
}

#ifdef __cplusplus
}
#endif
#endif
