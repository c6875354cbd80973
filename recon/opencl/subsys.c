/* What the host has of a restricted system on a device.  It is apart from system.c, which needs the table of ops.c. */
#include <string.h>

#include "recon/opencl/hull.h"

void rec_cl_take_subsys(rec_cl_system *y, int l, const int32_t *col, struct rec_subsys *to)
{
    struct rec_cl_part *a = &y->part[l];
    const double *entry = y->hull->entry[l], unit = (double)to->S->unit;
    to->card = &a->base;
    to->col = col;
    to->n = a->n;
    to->rows = a->rows;
    to->nnz = (uint64_t)entry[0];
    to->sum = unit * entry[1];
    to->sum2 = unit * unit * entry[2];
    to->slabs = 0;
    to->n_blocks = 0;
    for (size_t c = 0; c < to->S->n_cameras; c++)
        to->present[c] = (y->present >> c & 1) != 0;
}

void rec_cl_levels(const struct rec_subsys *fine, const struct rec_pictures *in,
                   struct rec_card_level *level, int n)
{
    rec_cl_system *y = rec_cl_part_of(fine)->of;
    (void)in; /* they were carved with */
    for (int i = 0; i < n; i++) {
        struct rec_cl_part *a = &y->part[i + 1];
        memcpy(level[i].col, y->hull->col[i + 1], (size_t)a->n * sizeof *level[i].col);
        rec_cl_take_subsys(y, i + 1, level[i].col, level[i].sub);
        a->b_here = level[i].b;
        a->w_here = level[i].w;
    }
}
