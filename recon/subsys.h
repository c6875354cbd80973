/* subsys.h - the restricted system of one frame set: hull columns of S, rows of present cameras.
 *
 *     minimise || W^(1/2) (A x - b) ||,  A = S(rows touched by H, columns H), H = hull       (1)
 *
 * A is copied out of S once per frame set, compact and twice: by rows for A x and by columns for
 * A^T y.  Why: the solver makes some thirty passes.  In the copy every output of either product is
 * one short gather, a row vector holds only the rays that meet the hull, all of it stays in cache,
 * and any split of the outputs over threads gives the same bits.
 * Copying reads the columns' runs of S twice: entries per row are counted, the rows numbered, and
 * every entry written to both copies, 4 bytes each: 3 to 5 ns per entry, what some five passes of the
 * solver cost.
 * All channels at once: x [n][cs], y [rows][cs], cs = 1 for one channel and 4 for three (the 4th lane
 * is 0), channel innermost.  Rows ascend by camera, then by bin.
 * Memory: 8 bytes per entry of A, and 12 per row of S that the hull is seen in and thread, in
 * reserved address space of S's size: only what is used costs.
 * Ownership: the object borrows S, kernels and pool; col is borrowed until the next restrict. */
#ifndef REC_SUBSYS_H
#define REC_SUBSYS_H
#include "base/pool.h"
#include "recon/kernels.h"
#include "recon/matrix/sysmat.h"

/* Work areas of restrict, of each strip of columns. */
#define REC_STRIPS_MAX 8
struct rec_place {
    uint32_t at, number; /* where the next entry of this row goes in by_row; the row in A */
};
struct rec_strip {
    uint32_t *count;         /* [row space] entries, 0 between two restrictions */
    struct rec_place *place; /* [row space] */
    uint8_t *touched;        /* [blocks of the row space] 1: counted in */
    uint32_t room;           /* entries of by_col, then the first of them */
    uint64_t sum, sum2;      /* of its entries, in units of S */
};

struct rec_subsys {
    const rec_sysmat *S;
    const struct rec_kernels *k;
    pvx_pool *pool;
    int cs;                   /* lanes per entry: 1 or 4 */
    int32_t n;                /* active columns */
    const int32_t *col;       /* [n] voxel indices, ascending */
    int32_t rows;             /* rows of A: of present cameras, with at least one entry */
    uint32_t *ray;            /* [rows] their numbers in S's row space */
    uint64_t nnz;             /* entries of A */
    struct rec_packed by_row; /* [rows] outputs, indices are active columns.  Values are those of
                                 S to 65536 columns and rows; beyond, rounded to the 32 - bits
                                 that an index leaves */
    struct rec_packed by_col; /* [n] outputs, indices are rows of A; padded with zero entries */
    float *norm2;             /* [n] column sums of squares: the diagonal of A^T A */
    double sum, sum2;         /* of all entries, of their squares */
    bool present[REC_MAX_CAMERAS];
    size_t row0[REC_MAX_CAMERAS + 1]; /* first row of each camera in S's row space */
    size_t strips;
    struct rec_strip strip[REC_STRIPS_MAX];
};

/* Copies S->row0 [n_cameras+1]; returns the rows in all. */
size_t rec_rowspace(const rec_sysmat *S, size_t *row0);

/* Sizes everything for S; cs 1 or 4.  Errors: PVX_ENOMEM; PVX_ERANGE: S has over 2^32-1 entries when
 * every column is padded, or over 2^26 voxels or rows. */
PVX_MUST_CHECK pvx_err rec_subsys_new(const rec_sysmat *S, const struct rec_kernels *k,
                                      pvx_pool *pool, int cs, struct rec_subsys **out);
void rec_subsys_free(struct rec_subsys **a);
/* Make it the system of columns col [n] (ascending) and the cameras present.  Parallel over strips of
 * columns; same bits for any number of threads; allocates nothing. */
void rec_subsys_restrict(struct rec_subsys *a, const int32_t *col, int32_t n, const bool *present);

/* y = A x;  x = A^T y.  Parallel over fixed chunks of the outputs. */
void rec_forward(const struct rec_subsys *a, const float *x, float *y);
void rec_adjoint(const struct rec_subsys *a, const float *y, float *x);
/* Column sums of w v^2 (diagonal of A^T W A) and of w v: d2, d1 [n], either may be NULL;
 * row_weight [rows] or NULL = 1. */
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

/* Pieces for solvers that fuse passes: outputs [i0,i1) of A x, of A^T y. */
static inline void rec_forward_range(const struct rec_subsys *a, const float *x, int32_t i0,
                                     int32_t i1, float *y)
{
    (a->cs == 4 ? a->k->packed4 : a->k->packed1)(&a->by_row, i0, i1, x, y);
}
static inline void rec_adjoint_range(const struct rec_subsys *a, const float *y, int32_t q0,
                                     int32_t q1, float *x)
{
    (a->cs == 4 ? a->k->packed4 : a->k->packed1)(&a->by_col, q0, q1, y, x);
}

/* Inner product of two vectors of n entries of a's lanes, in double over fixed chunks, lane by
 * lane; lanes that are not there give 0. */
void rec_dot(const struct rec_subsys *a, int32_t n, const float *u, const float *v, double out[4]);

#endif
