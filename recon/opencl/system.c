#include "recon/opencl/system.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/opencl/hull.h"
#include "recon/opencl/products.h"
#include "recon/opencl/solver.h"

/* ---- memory --------------------------------------------------------------------------------------*/

/* A coarse column has an active child, so no level has more columns than the next finer one. */
static pvx_err part_new(rec_cl_system *y, int l, size_t columns, struct pvx_diag *d)
{
    rec_cl *cl = y->m->cl;
    struct rec_cl_part *a = &y->part[l];
    const struct rec_cl_geometry *g = &y->m->level[l].g;
    size_t voxels = (size_t)g->voxels, rows = (size_t)g->room, cs = (size_t)y->cs;
    a->base.op = &rec_cl_ops;
    a->level = &y->m->level[l];
    a->room = (uint32_t)(columns < voxels ? columns : voxels);
    PVX_TRY(rec_cl_buffer_new(cl, voxels * sizeof(cl_int), &a->map, d));
    PVX_TRY(rec_cl_buffer_new(cl, a->room * sizeof(cl_int), &a->col, d));
    PVX_TRY(rec_cl_buffer_new(cl, a->room * 6 * sizeof(cl_int), &a->near, d));
    PVX_TRY(rec_cl_buffer_new(cl, (size_t)g->all_bricks * sizeof(cl_uint), &a->brick, d));
    PVX_TRY(rec_cl_buffer_new(cl, (size_t)g->all_tiles * sizeof(cl_uint), &a->tile, d));
    PVX_TRY(rec_cl_buffer_new(cl, rows, &a->is_row, d));
    PVX_TRY(rec_cl_buffer_new(cl, rows * cs * sizeof(float), &a->b, d));
    PVX_TRY(rec_cl_buffer_new(cl, rows * sizeof(float), &a->w, d));
    PVX_TRY(rec_cl_buffer_new(cl, cs == 4 ? rows * 4 * sizeof(float) : 0, &a->w4, d));
    return rec_cl_products_new(a, d);
}
static void part_free(rec_cl_system *y, int l)
{
    struct rec_cl_part *a = &y->part[l];
    struct rec_cl_buffer *const all[] = {&a->map,    &a->col, &a->near, &a->brick, &a->tile,
                                         &a->is_row, &a->b,   &a->w,    &a->w4};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        rec_cl_buffer_free(y->m->cl, all[i]);
    rec_cl_products_free(a);
}

pvx_err rec_cl_system_new(rec_cl_matrix *m, int cs, size_t columns, rec_cl_system **out,
                          struct pvx_diag *d)
{
    *out = NULL;
    rec_cl_system *y = pvx_calloc(1, sizeof *y);
    if (y == NULL)
        return pvx_fail(d, PVX_ENOMEM, "a frame set on a device: out of memory");
    y->m = rec_cl_matrix_share(m);
    y->cs = cs;
    y->columns = columns > 0 ? columns : 1;
    for (int l = 0; l < m->levels; l++)
        y->part[l].of = y; /* part_free needs it, however far this comes */
    pvx_err e = rec_cl_queue_new(m->cl, &y->queue, d);
    for (int l = 0; l < m->levels; l++)
        PVX_THEN(e, part_new(y, l, l == 0 ? y->columns : y->part[l - 1].room, d));
    PVX_THEN(e, rec_cl_hull_new(y, d));
    if (e != PVX_OK)
        rec_cl_system_free(&y);
    *out = y;
    return e;
}

void rec_cl_system_free(rec_cl_system **yp)
{
    rec_cl_system *y = *yp;
    if (y == NULL)
        return;
    rec_cl_hull_free(y);
    for (int l = 0; l < y->m->levels; l++)
        part_free(y, l);
    rec_cl_queue_free(&y->queue);
    rec_cl_matrix_free(&y->m);
    PVX_FREE(*yp);
}

/* ---- one frame set -------------------------------------------------------------------------------*/

/* Silhouettes that follow one another in memory go up together, as those of a frame do. */
static void upload_lit(rec_cl_system *y, const uint8_t *const *lit, const bool *present)
{
    const struct rec_cl_geometry *g = &y->m->level[0].g;
    for (int c = 0, end; c < g->cameras; c = end) {
        size_t row0 = (size_t)g->camera[c].row0, n = 0;
        for (end = c; end < g->cameras && present[end] && lit[end] == lit[c] + n; end++)
            n += (size_t)g->camera[end].bw * (size_t)g->camera[end].bh;
        end = present[c] ? end : c + 1;
        rec_cl_upload(y->queue, &y->hull->lit, row0, lit[c], n);
    }
}

static void upload_pictures(rec_cl_system *y, const struct rec_cl_carving *in)
{
    struct rec_cl_part *a = &y->part[0];
    size_t rows = (size_t)a->level->g.rows, bytes = rows * sizeof(float);
    rec_cl_upload(y->queue, &a->b, 0, in->in->b, bytes * (size_t)y->cs);
    rec_cl_upload(y->queue, &a->w, 0, in->weight, bytes);
    if (y->per_channel)
        rec_cl_upload(y->queue, &a->w4, 0, in->in->w, bytes * 4);
}

void rec_cl_system_pictures(const rec_cl_system *y, bool per_channel, struct rec_cl_pictures *out)
{
    const struct rec_cl_part *a = &y->part[0];
    *out = (struct rec_cl_pictures){.b = a->b, .w = a->w, .lit = y->hull->lit};
    if (per_channel)
        out->w4 = a->w4;
}

/* Pictures of cameras that the vote left out have no weight. */
static void dismiss_pictures(rec_cl_system *y)
{
    const struct rec_cl_part *a = &y->part[0];
    const struct rec_cl_geometry *g = &a->level->g;
    for (int c = 0; c < g->cameras; c++) {
        size_t at = (size_t)g->camera[c].row0 * sizeof(float);
        size_t bytes = (size_t)g->camera[c].bw * (size_t)g->camera[c].bh * sizeof(float);
        if (y->present >> c & 1)
            continue;
        rec_cl_zero(y->queue, &a->w, at, bytes);
        if (y->per_channel)
            rec_cl_zero(y->queue, &a->w4, at * 4, bytes * 4);
    }
}

static void take_totals(rec_cl_system *y)
{
    for (int l = 0; l < y->m->levels; l++) {
        struct rec_cl_part *a = &y->part[l];
        a->n = (int32_t)rec_cl_total_of(y, REC_CL_OF_ROWS, l).n;
        a->bricks = rec_cl_total_of(y, REC_CL_OF_BRICKS, l).n;
        a->tiles = rec_cl_total_of(y, REC_CL_OF_TILES, l).n;
        a->rows = (int32_t)rec_cl_total_of(y, REC_CL_OF_TILES, l).a;
    }
}

static void take_hull(const rec_cl_system *y, struct rec_hull_kept *kept)
{
    const struct rec_cl_total t = rec_cl_total_of(y, REC_CL_OF_BRICKS, 0);
    kept->n = y->part[0].n;
    kept->counts = (struct rec_hull_counts){.inside = t.a, .partial = t.b, .cut = t.c};
    kept->counts.outside = y->part[0].level->g.voxels - kept->counts.inside - kept->counts.partial;
}

bool rec_cl_carve(rec_cl_system *y, const struct rec_cl_carving *in, struct rec_hull_kept *kept,
                  struct rec_subsys *sub, bool *too_many)
{
    *too_many = false;
    sub->card = NULL;
    y->per_channel = in->in->per_channel;
    y->present = 0;
    for (int c = 0; c < y->m->level[0].g.cameras; c++)
        y->present |= (uint64_t)in->present[c] << c;
    if (in->there) {
        dismiss_pictures(y);
    } else {
        upload_lit(y, in->lit, in->present);
        upload_pictures(y, in);
    }
    y->part[0].b_here = in->in->b;
    y->part[0].w_here = in->in->w;
    rec_cl_hull_voxels(y, in->hull);
    rec_cl_columns(y);
    rec_cl_rows(y);
    rec_cl_averages(y);
    rec_cl_totals(y);
    if (!rec_cl_wait(y->queue))
        return false;
    take_totals(y);
    *too_many = (size_t)y->part[0].n > y->columns;
    if (*too_many)
        return false;
    for (int l = 0; l < y->m->levels; l++)
        rec_cl_download(y->queue, &y->part[l].col, 0, l == 0 ? kept->col : y->hull->col[l],
                        (size_t)y->part[l].n * sizeof(int32_t));
    if (!rec_cl_wait(y->queue))
        return false;
    take_hull(y, kept);
    rec_cl_take_subsys(y, 0, kept->col, sub);
    return true;
}
