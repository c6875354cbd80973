/* subsys.h - the restricted system of one frame set: hull columns of S, rows of present cameras.
 *
 *     minimise || W^(1/2) (A x - b) ||,  A = S(rows touched by H, columns H), H = hull       (1)
 *
 * A consists of the windows of the hull's columns, copied from S unchanged.  Rows keep their places in the
 * images, so nothing is renumbered, and one copy serves both products.  A^T y gathers: one output per column.
 * A x scatters: the columns are cut into slabs.  Each slab adds into its own images, which are then summed in
 * order, bin by bin.  The number of slabs depends on the number of columns alone, so the bits do not depend on
 * the threads.
 * Only the bins of the images that the windows cover are used, in blocks of REC_ROW_BLOCK bins; a slab of
 * neighbouring voxels covers a part of them.  A row is a bin in which some weight is not 0.  Other bins of a
 * block are not rows: products leave 0 there, and they must have no weight.
 * All channels at once: x [n][cs], y [S->win.room][cs], cs = 1 for one channel and 4 for three (the 4th
 * lane is free), channel innermost.
 * Memory: 4 + high*wide bytes per voxel and camera, and in the restrictor 7 bytes per row and slab, in
 * reserved address space of S's size: only what is used costs.
 * Ownership: the object borrows S, kernels and pool; col is borrowed until the next restrict. */
#ifndef REC_SUBSYS_H
#define REC_SUBSYS_H
#include <stdatomic.h>
#include "base/pool.h"
#include "recon/matrix/sysmat.h"
#include "recon/simd/kernels.h"
#include "recon/simd/lanes.h"

#define REC_SLABS_MAX 32

/* Work areas of restrict, for S and its coarser levels: one restriction at a time. */
struct rec_slab {
    uint8_t *row;   /* [room] not 0: a row; all 0 between two restrictions */
    uint16_t *seen; /* [room] weights of the windows that begin there: bit k, the k-th of some
                                is not 0; as above */
    uint32_t *place, places; /* [room] windows with which such a bin was met first */
    uint64_t sum, sum2, nnz; /* of its weights */
};
struct rec_restrictor {
    size_t room, voxels; /* of S */
    struct rec_slab slab[REC_SLABS_MAX];
    _Atomic uint32_t *covered; /* [blocks] bit s: by a window of slab s; as above */
    int32_t *list;             /* [voxels] levels.h */
};

struct rec_card_system; /* recon/solve/card.h */

struct rec_subsys {
    const rec_sysmat *S;
    /* NULL: here.  Else on a graphics card: then `win`, blocks, is_row and norm2 are not valid here. */
    struct rec_card_system *card;
    const struct rec_kernels *k;
    pvx_pool *pool;
    int cs;                 /* floats per entry: 1 or 4 */
    int32_t n;              /* active columns */
    const int32_t *col;     /* [n] voxel indices, ascending */
    int32_t rows;           /* rows of A: those of present cameras with at least one entry */
    uint64_t nnz;           /* entries of A */
    struct rec_windows win; /* [n] columns; of `more` those of slab s are [more_at[s], more_end[s]),
                               their columns active ones */
    uint32_t more_at[REC_SLABS_MAX], more_end[REC_SLABS_MAX];
    int32_t slabs;
    int32_t n_blocks;
    uint32_t *block;    /* [n_blocks] ascending: bins REC_ROW_BLOCK * block ... */
    uint32_t *slabs_of; /* [n_blocks] bit s: covered by slab s */
    uint8_t *is_row;    /* [room] not 0: a row; valid only in the blocks */
    float *norm2;       /* [n] column sums of squares: the diagonal of A^T A */
    double sum, sum2;   /* of all entries, of their squares */
    bool present[REC_MAX_CAMERAS];
    size_t row0[REC_MAX_CAMERAS + 1]; /* first row of each camera; then the number of bins */
};

/* Sizes everything for S; cs 1 or 4.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_subsys_new(const rec_sysmat *S, const struct rec_kernels *k,
                                      pvx_pool *pool, int cs, struct rec_subsys **out);
void rec_subsys_free(struct rec_subsys **a);
/* Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_restrictor_new(const rec_sysmat *S, struct rec_restrictor **out);
void rec_restrictor_free(struct rec_restrictor **r);
/* Makes `a` the system of columns col [n] (ascending) and the cameras present.  Parallel over slabs of columns and
 * ranges of rows; same bits for any number of threads; allocates nothing. */
void rec_subsys_restrict(struct rec_subsys *a, struct rec_restrictor *r, const int32_t *col,
                         int32_t n, const bool *present);

/* Column sums of w v^2 (diagonal of A^T W A) and of w v: d2, d1 [n], either may be NULL;
 * row_weight [room] or NULL = 1. */
void rec_column_norms(const struct rec_subsys *a, const float *row_weight, float *d2, float *d1);

/* First of n ascending columns that is >= v; n when none is. */
static inline int32_t rec_first_column(const int32_t *col, int32_t n, int32_t v)
{
    int32_t lo = 0, hi = n;
    while (lo < hi) {
        int32_t mid = lo + (hi - lo) / 2;
        if (col[mid] < v)
            lo = mid + 1;
        else
            hi = mid;
    }
    return lo;
}

/* Loops over columns or rows are cut into at most REC_MAX_CHUNKS pieces of rec_chunk(n): the cut
 * depends on n alone, so sums that are added up piece by piece do not depend on the threads. */
#define REC_MAX_CHUNKS 256
static inline int32_t rec_chunk(int32_t n)
{
    int32_t c = n / REC_MAX_CHUNKS + 1, least = n / 12 < 64 ? 64 : n / 12 > 512 ? 512 : n / 12;
    return c < least ? least : c;
}
static inline size_t rec_chunks(int32_t n)
{
    int32_t c = rec_chunk(n);
    return (size_t)((n + c - 1) / c);
}
static inline void rec_chunk_range(int32_t n, size_t k, int32_t *i0, int32_t *i1)
{
    int32_t c = rec_chunk(n);
    *i0 = (int32_t)k * c;
    *i1 = n - *i0 < c ? n : *i0 + c;
}

/* Columns [q0,q1) of a slab. */
static inline void rec_slab_range(const struct rec_subsys *a, size_t slab, int32_t *q0, int32_t *q1)
{
    *q0 = (int32_t)((int64_t)a->n * (int64_t)slab / a->slabs);
    *q1 = (int32_t)((int64_t)a->n * (int64_t)(slab + 1) / a->slabs);
}

/* Passes over rows are cut into chunks of blocks in the same way. */
static inline size_t rec_row_pieces(const struct rec_subsys *a)
{
    return rec_chunks(a->n_blocks);
}
struct rec_block_range {
    int32_t at, end;
};
static inline struct rec_block_range rec_blocks_of(const struct rec_subsys *a, size_t k)
{
    struct rec_block_range r;
    rec_chunk_range(a->n_blocks, k, &r.at, &r.end);
    return r;
}
/* for (every bin i of some blocks; of chunk k): rows, and bins of weight 0.
 * NOLINTBEGIN(bugprone-macro-parentheses): i is declared here */
#define REC_FOR_BINS(i, a, range, by)                                                           \
    for (struct rec_block_range i##_ = (range); i##_.at < i##_.end; i##_.at++)                  \
        for (size_t i = (size_t)(a)->block[i##_.at] * REC_ROW_BLOCK, i##_n = i + REC_ROW_BLOCK; \
             i < i##_n; i += (by))
#define REC_FOR_BLOCK_ROWS(i, a, range) REC_FOR_BINS (i, a, range, 1)
#define REC_FOR_ROWS(i, a, k)           REC_FOR_BINS (i, a, rec_blocks_of(a, k), 1)
/* for (the first of every four). */
#define REC_FOR_ROW_QUADS(i, a, k) REC_FOR_BINS (i, a, rec_blocks_of(a, k), 4)
/* NOLINTEND(bugprone-macro-parentheses) */

/* x[q0,q1) = A^T y.  Every bin that a window covers is read: all of y's blocks have to be finite, and
 * its last bins, from S->win.nowhere on, 0. */
void rec_adjoint_range(const struct rec_subsys *a, const float *y, int32_t q0, int32_t q1,
                       float *x);

/* The slabs' images, for S and coarser levels.  They serve one product at a time and are 0 between two products,
 * because collecting leaves 0 behind. */
struct rec_images {
    size_t bytes;
    float *of[REC_SLABS_MAX]; /* [room][cs] */
};
PVX_MUST_CHECK pvx_err rec_images_new(const rec_sysmat *S, int cs, struct rec_images *out);
void rec_images_free(struct rec_images *im);
/* rec_scatter computes A x into the images (parallel).  rec_collect then writes their sum to y, some blocks at a time
 * and each block once. */
void rec_scatter(const struct rec_subsys *a, struct rec_images *im, const float *x);
void rec_collect(const struct rec_subsys *a, struct rec_images *im, struct rec_block_range blocks,
                 float *y);
/* Both: y = A x in all blocks. */
void rec_forward(const struct rec_subsys *a, struct rec_images *im, const float *x, float *y);

/* The same on the calling thread alone, without images: for a small system, where threads are better used on several
 * products at once. */
void rec_forward_alone(const struct rec_subsys *a, const float *x, float *y);

/* The same with the rows of cameras [c0,c1) alone. */
struct rec_cameras {
    int32_t c0, c1;
};
void rec_scatter_cameras(const struct rec_subsys *a, struct rec_images *im, struct rec_cameras c,
                         const float *x);
/* y += A x, without images; of the other cameras' bins some get 0 added. */
void rec_add_forward_alone(const struct rec_subsys *a, struct rec_cameras c, const float *x,
                           float *y);
void rec_adjoint_cameras(const struct rec_subsys *a, struct rec_cameras c, const float *y,
                         int32_t q0, int32_t q1, float *x);
void rec_column_sums_cameras(const struct rec_subsys *a, struct rec_cameras c,
                             const float *row_weight, float *d1);
/* Adds column q of slab `slab` times e, lane by lane, to the image of that slab. */
void rec_add_column(const struct rec_subsys *a, const struct rec_images *im, size_t slab, int32_t q,
                    rec_f4 e);

/* Inner product of two vectors of n entries of a's lanes, in double over fixed chunks, lane by
 * lane; lanes that are not there give 0. */
void rec_dot(const struct rec_subsys *a, int32_t n, const float *u, const float *v, double out[4]);

#endif
