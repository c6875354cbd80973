/* products.h - products with a restricted system on a device, and what it takes to make one.  Private to recon/opencl.
 *
 *     y = A x: each bin adds up, brick by brick, its entries, in float; the sums of bricks are added in float, in four
 *     rows that are added last.  x = A'y: each voxel adds up its windows, camera by camera, in float.
 * Rounding: |error| <= g |A||x|, g = m eps / (1 - m eps), m the number of terms plus bricks plus 4 (NUMERICS.md).
 * All functions enqueue and return.  cs: lanes of x and y, 1 or 4, whatever the pictures have (blend.h).
 * What a product reads of y are rows of A alone; other bins may have anything. */
#ifndef REC_CL_PRODUCTS_H
#define REC_CL_PRODUCTS_H
#include "recon/opencl/system.h"

/* Makes a->products; a->level and a->of, with its cs, are set.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_cl_products_new(struct rec_cl_part *a, struct pvx_diag *d);
void rec_cl_products_free(struct rec_cl_part *a);

/* is_row of all bins, and a->products of a system whose map is known.  A bin is a row if a column of a present camera
 * has a weight in it.  a->bricks and the like need not be known. */
void rec_cl_mark_rows(rec_cl_queue *q, const struct rec_cl_part *a);
/* After it: the number of A's entries, their sum and the sum of their squares, in units: exact, as parts of slots slot,
 * slot + 1 and slot + 2, lane 0, `*groups` of them. */
void rec_cl_count_entries(rec_cl_queue *q, const struct rec_cl_part *a, uint32_t slot,
                          uint32_t *groups);

/* y = A x in all bins of active tiles, or y += A x, which leaves y's bits where A x is 0.  A brick whose x is 0 costs next
 * to nothing. */
void rec_cl_forward(rec_cl_queue *q, const struct rec_cl_part *a, int cs,
                    const struct rec_cl_buffer *x, const struct rec_cl_buffer *y, bool add);
/* x = A'y. */
void rec_cl_adjoint(rec_cl_queue *q, const struct rec_cl_part *a, int cs,
                    const struct rec_cl_buffer *y, const struct rec_cl_buffer *x);
/* d2 [n]: column sums of w v^2, to the bit as rec_column_norms; parts of slot `slot`, lane 0: their sum, and of the next
 * slot: the sum of w v; `*groups` of them. */
void rec_cl_column_norms(rec_cl_queue *q, const struct rec_cl_part *a,
                         const struct rec_cl_buffer *weight, const struct rec_cl_buffer *d2,
                         uint32_t slot, uint32_t *groups);

#endif
