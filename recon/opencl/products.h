/* products.h - products with a restricted system on a device, and what it takes to make one.  Private to recon/opencl.
 *
 *     y = A x: each bin adds up, brick by brick in ascending order, the columns whose window holds it, in float; the
 *     sums of bricks are added in float.  x = A'y: each voxel adds up its windows, camera by camera, in float.
 * Rounding: |error| <= g |A||x|, g = m eps / (1 - m eps), m the number of terms plus bricks (NUMERICS.md).
 * All functions enqueue and return.  cs: lanes of x and y, 1 or 4, whatever the pictures have (blend.h). */
#ifndef REC_CL_PRODUCTS_H
#define REC_CL_PRODUCTS_H
#include "recon/opencl/system.h"

/* y = A x in all rows of active tiles, or y += A x. */
void rec_cl_forward(rec_cl_queue *q, const struct rec_cl_part *a, int cs,
                    const struct rec_cl_buffer *x, const struct rec_cl_buffer *y, bool add);
/* x = A'y. */
void rec_cl_adjoint(rec_cl_queue *q, const struct rec_cl_part *a, int cs,
                    const struct rec_cl_buffer *y, const struct rec_cl_buffer *x);
/* is_row of all bins of a system whose map and bricks are known.  A bin is a row if a column of a present camera has
 * a weight in it. */
void rec_cl_mark_rows(rec_cl_queue *q, const struct rec_cl_part *a);
/* The number of A's entries, their sum and the sum of their squares, in units: exact, as parts of slots 0..2 of lane 0,
 * `*groups` of them. */
void rec_cl_count_entries(rec_cl_queue *q, const struct rec_cl_part *a, uint32_t *groups);
/* d2 [n]: column sums of w v^2; parts of slot 0, lane 0: their sum, and of slot 1: the sum of w v. */
void rec_cl_column_norms(rec_cl_queue *q, const struct rec_cl_part *a,
                         const struct rec_cl_buffer *weight, const struct rec_cl_buffer *d2,
                         uint32_t *groups);

#endif
