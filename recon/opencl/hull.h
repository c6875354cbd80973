/* hull.h - the work areas of a carving, and its steps on the device.  Private to recon/opencl.
 *
 * Every step enqueues and returns, and none needs a number that only the device knows: a set is carved on all levels
 * with one wait for its counts, and another for its columns.
 * Words are counts of the rows of voxels, the bricks and the tiles of all levels; scan.cl sums them up. */
#ifndef REC_CL_HULL_H
#define REC_CL_HULL_H
#include "recon/opencl/system.h"

/* What is counted of a level: columns of its rows of voxels, active bricks, active tiles. */
enum { REC_CL_OF_ROWS, REC_CL_OF_BRICKS, REC_CL_OF_TILES, REC_CL_COUNTED };

struct rec_cl_total {
    uint32_t n, a, b, c; /* of bricks: active; inside, partial, cut.  Of tiles: active; rows */
};

struct rec_cl_hull {
    uint32_t pad, high, bands, across; /* of the tables: hull.cl */
    uint32_t lists, share;
    struct rec_cl_place place[REC_CL_LEVELS];
    struct rec_cl_range range[REC_CL_COUNTED * REC_CL_LEVELS]; /* [counted][levels] */
    uint32_t words, groups;                                    /* in all ranges */

    struct rec_cl_buffer places, ranges;
    struct rec_cl_buffer lit;             /* uchar [rows] */
    struct rec_cl_buffer sat, band;       /* uint */
    struct rec_cl_buffer open, views;     /* ulong, uchar [bricks] */
    struct rec_cl_buffer list, listed;    /* uint [lists][GROUP], [lists] */
    struct rec_cl_buffer mask;            /* ulong [bricks of all levels] */
    struct rec_cl_buffer word, at;        /* uint [words] */
    struct rec_cl_buffer sums;            /* uint4 [groups] */
    struct rec_cl_buffer totals, entries; /* uint4 [counted][levels], double4 [levels] */

    struct rec_cl_total total[REC_CL_COUNTED * REC_CL_LEVELS];
    double entry[REC_CL_LEVELS][4]; /* number, sum, sum of squares, in units */
    int32_t *col[REC_CL_LEVELS];    /* of coarser levels, here */
};

PVX_MUST_CHECK pvx_err rec_cl_hull_new(rec_cl_system *y, struct pvx_diag *d);
void rec_cl_hull_free(rec_cl_system *y);

static inline const struct rec_cl_range *rec_cl_range_of(const rec_cl_system *y, int counted,
                                                         int level)
{
    return &y->hull->range[counted * y->m->levels + level];
}
static inline struct rec_cl_total rec_cl_total_of(const rec_cl_system *y, int counted, int level)
{
    return y->hull->total[counted * y->m->levels + level];
}

/* hull.c: the voxels of the finest level, from silhouettes that are on the device. */
void rec_cl_hull_voxels(rec_cl_system *y, const struct rec_hull_params *p);
/* columns.c: columns, rows and counts of all levels; then the totals, to be downloaded. */
void rec_cl_columns(rec_cl_system *y);
void rec_cl_rows(rec_cl_system *y);
void rec_cl_totals(rec_cl_system *y);
/* The pictures of the coarser levels. */
void rec_cl_averages(rec_cl_system *y);

/* subsys.c: `to`, of the given level, as rec_subsys_restrict leaves it, but for what is on the device. */
void rec_cl_take_subsys(rec_cl_system *y, int level, const int32_t *col, struct rec_subsys *to);

#endif
