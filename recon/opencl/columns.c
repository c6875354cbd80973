/* columns.c - from voxels to columns, rows and coarser levels (kernels/levels.cl, scan.cl). */
#include "recon/opencl/hull.h"
#include "recon/opencl/products.h"

static size_t groups_of(size_t n)
{
    return (n + REC_CL_FLAT - 1) / REC_CL_FLAT;
}

/* Sums up the words of these ranges. */
static void columns_scan(rec_cl_system *y, int first, int n)
{
    const struct rec_cl_hull *h = y->hull;
    const struct rec_cl_range *last = &h->range[first + n - 1];
    const cl_uint group = h->range[first].group, range = (cl_uint)first;
    size_t groups = last->group + last->groups - group;
    REC_CL_RUN(y->queue, REC_CL_K_SCAN_SUM, 1, groups, REC_CL_FLAT, REC_CL_BUFFER(&h->ranges),
               REC_CL_VALUE(group), REC_CL_BUFFER(&h->word), REC_CL_BUFFER(&h->sums));
    REC_CL_RUN(y->queue, REC_CL_K_SCAN_TOTAL, 1, (size_t)n, REC_CL_FLAT, REC_CL_BUFFER(&h->ranges),
               REC_CL_VALUE(range), REC_CL_BUFFER(&h->sums), REC_CL_BUFFER(&h->totals));
    REC_CL_RUN(y->queue, REC_CL_K_SCAN_PLACE, 1, groups, REC_CL_FLAT, REC_CL_BUFFER(&h->ranges),
               REC_CL_VALUE(group), REC_CL_BUFFER(&h->word), REC_CL_BUFFER(&h->sums),
               REC_CL_BUFFER(&h->at));
}

/* Lists what was counted, ascending. */
static void columns_list(rec_cl_system *y, int counted, int level, const struct rec_cl_buffer *list)
{
    const struct rec_cl_hull *h = y->hull;
    const struct rec_cl_range *r = rec_cl_range_of(y, counted, level);
    REC_CL_RUN(y->queue, REC_CL_K_SCAN_LIST, 1, groups_of(r->n), REC_CL_FLAT, REC_CL_VALUE(r->at),
               REC_CL_VALUE(r->n), REC_CL_BUFFER(&h->word), REC_CL_BUFFER(&h->at),
               REC_CL_BUFFER(list));
}

/* ---- columns -------------------------------------------------------------------------------------*/

static void columns_masks(rec_cl_system *y)
{
    const struct rec_cl_hull *h = y->hull;
    const struct rec_cl_place *last = &h->place[y->m->levels - 1];
    const cl_uint rows = last->row + last->rows;
    for (cl_uint l = 1; l < (cl_uint)y->m->levels; l++)
        REC_CL_RUN(y->queue, REC_CL_K_LEVELS_MASK, 1, groups_of(h->place[l].all_bricks),
                   REC_CL_FLAT, REC_CL_BUFFER(&h->places), REC_CL_VALUE(l), REC_CL_BUFFER(&h->mask),
                   REC_CL_BUFFER(&h->word),
                   REC_CL_VALUE(rec_cl_range_of(y, REC_CL_OF_BRICKS, (int)l)->at));
    REC_CL_RUN(y->queue, REC_CL_K_LEVELS_ROWS, 1, groups_of(rows), REC_CL_FLAT,
               REC_CL_BUFFER(&h->places), REC_CL_VALUE(rows), REC_CL_BUFFER(&h->mask),
               REC_CL_BUFFER(&h->word));
}

void rec_cl_columns(rec_cl_system *y)
{
    const struct rec_cl_hull *h = y->hull;
    columns_masks(y);
    columns_scan(y, 0, REC_CL_OF_TILES * y->m->levels);
    for (cl_uint l = 0; l < (cl_uint)y->m->levels; l++) {
        const struct rec_cl_part *a = &y->part[l];
        const size_t rows = h->place[l].rows;
        REC_CL_RUN(y->queue, REC_CL_K_LEVELS_FILL, 1, rows, REC_CL_GROUP, REC_CL_BUFFER(&h->places),
                   REC_CL_VALUE(l), REC_CL_VALUE(a->room), REC_CL_BUFFER(&h->mask),
                   REC_CL_BUFFER(&h->at), REC_CL_BUFFER(&a->map), REC_CL_BUFFER(&a->col));
        REC_CL_RUN(y->queue, REC_CL_K_LEVELS_NEAR, 1, rec_cl_groups(a->room), REC_CL_FLAT,
                   REC_CL_BUFFER(&h->places), REC_CL_VALUE(l), REC_CL_VALUE(a->room),
                   REC_CL_BUFFER(&h->totals), REC_CL_BUFFER(&a->map), REC_CL_BUFFER(&a->col),
                   REC_CL_BUFFER(&a->near));
        columns_list(y, REC_CL_OF_BRICKS, (int)l, &a->brick);
    }
}

/* ---- rows ----------------------------------------------------------------------------------------*/

void rec_cl_rows(rec_cl_system *y)
{
    const struct rec_cl_hull *h = y->hull;
    for (int l = 0; l < y->m->levels; l++) {
        const struct rec_cl_part *a = &y->part[l];
        const struct rec_cl_range *r = rec_cl_range_of(y, REC_CL_OF_TILES, l);
        uint32_t groups = 0;
        rec_cl_mark_rows(y->queue, a);
        rec_cl_count_entries(y->queue, a, 0, &groups);
        REC_CL_RUN(y->queue, REC_CL_K_LEVELS_ENTRIES, 1, 1, REC_CL_FLAT, REC_CL_VALUE(groups),
                   REC_CL_BUFFER(rec_cl_parts(y->queue)), REC_CL_BUFFER(&h->entries),
                   REC_CL_VALUE(l));
        REC_CL_RUN(y->queue, REC_CL_K_LEVELS_TILES, 1, groups_of(r->n), REC_CL_FLAT,
                   REC_CL_VALUE(r->n), REC_CL_BUFFER(&a->products.tile_rows),
                   REC_CL_BUFFER(&h->word), REC_CL_VALUE(r->at));
    }
    columns_scan(y, REC_CL_OF_TILES * y->m->levels, y->m->levels);
    for (int l = 0; l < y->m->levels; l++)
        columns_list(y, REC_CL_OF_TILES, l, &y->part[l].tile);
}

void rec_cl_totals(rec_cl_system *y)
{
    struct rec_cl_hull *h = y->hull;
    rec_cl_download(y->queue, &h->totals, 0, h->total, sizeof h->total);
    rec_cl_download(y->queue, &h->entries, 0, h->entry, sizeof h->entry);
}

/* ---- pictures ------------------------------------------------------------------------------------*/

void rec_cl_averages(rec_cl_system *y)
{
    const struct rec_cl_part *fine = &y->part[0];
    const enum rec_cl_kernel k =
        y->per_channel ? REC_CL_K_LEVELS_AVERAGE4 : REC_CL_K_LEVELS_AVERAGE;
    for (cl_int l = 1; l < y->m->levels; l++) {
        const struct rec_cl_part *a = &y->part[l];
        REC_CL_RUN(y->queue, k, y->cs, (size_t)a->level->g.all_tiles, REC_CL_GROUP,
                   REC_CL_BUFFER(&a->level->geometry), REC_CL_BUFFER(&fine->level->geometry),
                   REC_CL_VALUE(l), REC_CL_BUFFER(&a->products.tile_rows),
                   REC_CL_BUFFER(&a->is_row), REC_CL_BUFFER(&fine->b),
                   REC_CL_BUFFER(y->per_channel ? &fine->w4 : &fine->w), REC_CL_BUFFER(&a->b),
                   REC_CL_BUFFER(y->per_channel ? &a->w4 : &a->w));
    }
}
