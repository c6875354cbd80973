/* subsys.h - the restricted system of one frame set: hull columns of S, rows of present cameras.
 *
 *     minimise || W^(1/2) (A x - b) ||,  A = S restricted to columns col[0..n)         (1)
 *
 * Nothing of S is copied (sysmat.h says why); A is (S, col[]).  All channels at once: a vector in
 * voxel space is x [n][cs], in row space y [rows of camera 0][cs], [rows of camera 1][cs] ... with
 * cs = 1 for one channel and 4 for three (the 4th lane is 0), channel innermost.
 * Only `span` rows of a camera are touched by A; outside them y means nothing, is never changed, but
 * must be finite (kernels.h: over-read).  The 4th lane of x and y is 0 on input and stays 0.
 * Ownership: rec_subsys is a view that borrows S and the arrays of the hull that made it. */
#ifndef REC_SUBSYS_H
#define REC_SUBSYS_H
#include "base/pool.h"
#include "recon/kernels.h"
#include "recon/sysmat.h"

struct rec_subsys {
    const rec_sysmat *S;
    const struct rec_kernels *k;
    pvx_pool *pool;
    int cs;                /* lanes per entry: 1 or 4 */
    int32_t n;             /* active columns */
    const int32_t *col;    /* [n] voxel indices, ascending */
    uint64_t nnz;          /* entries of A */
    int64_t rows;          /* rows of A that have an entry and a present camera */
    bool present[REC_MAX_CAMERAS];
    size_t row0[REC_MAX_CAMERAS + 1];                /* first row of each camera in row space */
    struct { uint32_t lo, hi; } span[REC_MAX_CAMERAS]; /* touched rows of camera c: [lo,hi) */
    const uint8_t *touched;                          /* [rowspace] 1: the row has an entry of A */
};

/* Loops over active columns are cut into at most REC_MAX_CHUNKS pieces of rec_chunk(n) columns: the
 * cut depends on n alone, so sums that are added up piece by piece do not depend on the threads. */
#define REC_MAX_CHUNKS 256
static inline int32_t rec_chunk(int32_t n)
{
    int32_t c = n / REC_MAX_CHUNKS + 1;
    return c < 512 ? 512 : c;
}
static inline size_t rec_chunks(int32_t n)
{
    int32_t c = rec_chunk(n);
    return (size_t)((n + c - 1) / c);
}

/* Total rows of S in row space: sum over cameras of bw*bh; fills row0 [n_cameras+1]. */
size_t rec_rowspace(const rec_sysmat *S, size_t *row0);

/* Fill the view for columns col [n] (borrowed) and the cameras present: spans, nnz, rows.  touched
 * [rowspace] is filled, borrowed.  Parallel over cameras. */
void rec_subsys_init(struct rec_subsys *a, const rec_sysmat *S, const struct rec_kernels *k,
                     pvx_pool *pool, int cs, const int32_t *col, int32_t n, const bool *present,
                     uint8_t *touched);

/* y = A x.  x [n][cs], y [rowspace][cs] out (spans only).  Parallel over cameras. */
void rec_forward(const struct rec_subsys *a, const float *x, float *y);
/* x = A^T y.  Parallel over fixed chunks of columns. */
void rec_adjoint(const struct rec_subsys *a, const float *y, float *x);
/* Column sums of squares (diagonal of A^T A) and of entries: d2, d1 [n], either may be NULL. */
void rec_column_norms(const struct rec_subsys *a, const float *row_weight, float *d2, float *d1);

/* Pieces for solvers that fuse passes: columns [q0,q1) of A^T y; one lane-wise inner product of n
 * entries, serial; sum of n partial results in order. */
void rec_adjoint_range(const struct rec_subsys *a, const float *y, int32_t q0, int32_t q1, float *x);
void rec_dot_range(const float *u, const float *v, size_t n, int cs, double out[4]);
void rec_sum_parts(const double (*part)[4], size_t n, double out[4]);

/* Inner products in double over fixed chunks, one result per channel lane: out[4]. */
void rec_dot_x(const struct rec_subsys *a, const float *u, const float *v, double out[4]);
void rec_dot_y(const struct rec_subsys *a, const float *u, const float *v, double out[4]);

#endif
