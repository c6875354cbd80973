#include "recon/opencl/matrix.h"

#include <stdlib.h>

#include "base/mem.h"
#include "recon/matrix/active.h"
#include "recon/opencl/upload.h"

/* What a kernel counts in an int. */
static pvx_err matrix_fits(const rec_sysmat *S, struct pvx_diag *d)
{
    size_t places = rec_brick_places(&S->grid);
    if (places > INT32_MAX || S->win.room > INT32_MAX)
        return pvx_fail(d, PVX_ERANGE,
                        "the system matrix has %zu voxels in bricks and %zu rows; on a graphics "
                        "card it may have 2147483647 of each: use fewer voxels or larger bins",
                        places, (size_t)S->win.room);
    return PVX_OK;
}

static void geometry_of(const rec_sysmat *S, struct rec_cl_geometry *g)
{
    *g =
        (struct rec_cl_geometry){.voxels = (int)rec_grid_count(&S->grid),
                                 .all_bricks = (int)(rec_brick_places(&S->grid) / REC_BRICK_VOXELS),
                                 .cameras = (int)S->n_cameras,
                                 .wide = S->win.wide,
                                 .high = S->win.high,
                                 .rows = (int)S->row0[S->n_cameras],
                                 .room = (int)S->win.room,
                                 .unit = S->win.unit};
    for (int a = 0; a < 3; a++) {
        g->n[a] = S->grid.n[a];
        g->bricks[a] = rec_bricks(&S->grid, a);
    }
    for (size_t c = 0; c < S->n_cameras; c++) {
        int bw = S->block[c].bw, bh = S->block[c].bh;
        int tiles = (bw + REC_CL_TILE - 1) / REC_CL_TILE;
        g->camera[c] =
            (struct rec_cl_camera){(int)S->row0[c], bw, bh, tiles, .tile0 = g->all_tiles};
        g->all_tiles += tiles * ((bh + REC_CL_TILE - 1) / REC_CL_TILE);
    }
}

static pvx_err level_upload(rec_cl_queue *q, struct rec_cl_level *l, int32_t *store,
                            uint32_t *brick, bool finest, struct pvx_diag *d)
{
    const struct rec_active *part = l->S->active;
    for (int b = 0; b < l->g.all_bricks; b++) {
        store[b] = part == NULL || part->brick[b] ? (int32_t)l->stored : -1;
        if (store[b] >= 0)
            brick[l->stored++] = (uint32_t)b;
    }
    PVX_TRY(rec_cl_part_from(q, "sizes", &l->g, sizeof l->g, &l->geometry, d));
    PVX_TRY(rec_cl_part_from(q, "bricks", store, (size_t)l->g.all_bricks * sizeof *store, &l->store,
                             d));
    PVX_TRY(rec_cl_part_from(q, "bricks", brick, l->stored * sizeof *brick, &l->brick, d));
    const struct rec_cl_order o = {store, brick};
    PVX_TRY(rec_cl_upload_columns(q, l, &o, d));
    PVX_TRY(rec_cl_make_rows(q, l, d));
    return finest ? rec_cl_upload_footprints(q, l, &o, d) : PVX_OK;
}

static pvx_err level_new(rec_cl_queue *q, struct rec_cl_level *l, const rec_sysmat *S, bool finest,
                         struct pvx_diag *d)
{
    PVX_TRY(matrix_fits(S, d));
    l->S = S;
    geometry_of(S, &l->g);
    size_t bricks = (size_t)l->g.all_bricks;
    int32_t *store = pvx_calloc(bricks, sizeof *store);
    uint32_t *brick = pvx_calloc(bricks, sizeof *brick);
    pvx_err e =
        store == NULL || brick == NULL ? PVX_ENOMEM : level_upload(q, l, store, brick, finest, d);
    free(store);
    free(brick);
    return e;
}

static void level_free(rec_cl *cl, struct rec_cl_level *l)
{
    struct rec_cl_buffer *all[] = {&l->geometry,   &l->store,     &l->brick,     &l->at,
                                   &l->w,          &l->more,      &l->more_from, &l->tile_from,
                                   &l->pair_brick, &l->pair_bins, &l->pair_at,   &l->rows,
                                   &l->fp,         &l->rect};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        rec_cl_buffer_free(cl, all[i]);
}

static pvx_err matrix_fill(rec_cl_matrix *m, const rec_sysmat *S, struct pvx_diag *d)
{
    PVX_TRY(rec_cl_queue_new(m->cl, &m->queue, d));
    for (const rec_sysmat *s = S; s != NULL; s = s->coarse) {
        if (m->levels == REC_CL_LEVELS)
            return pvx_fail(d, PVX_ERANGE, "the system matrix has more than %d levels",
                            REC_CL_LEVELS);
        PVX_TRY(level_new(m->queue, &m->level[m->levels++], s, s == S, d));
    }
    if (!rec_cl_wait(m->queue))
        return pvx_fail(d, PVX_ENODEV, "%s: %s", rec_cl_about(m->cl)->name, rec_cl_lost(m->cl));
    rec_cl_queue_free(&m->queue);
    rec_sysmat_let_go(S); /* no frame set needs all of it */
    return PVX_OK;
}

pvx_err rec_cl_matrix_new(rec_cl *cl, const rec_sysmat *S, rec_cl_matrix **out, struct pvx_diag *d)
{
    rec_cl_matrix *m = *out = pvx_calloc(1, sizeof *m);
    if (m == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for the system matrix");
    m->cl = cl;
    m->users = 1;
    pvx_err e = matrix_fill(m, S, d);
    if (e == PVX_OK)
        return e;
    rec_cl_matrix_free(out);
    return pvx_fail(d, e, "out of memory for the system matrix on its way to a device");
}

rec_cl_matrix *rec_cl_matrix_share(rec_cl_matrix *m)
{
    m->users++;
    return m;
}

void rec_cl_matrix_free(rec_cl_matrix **mp)
{
    rec_cl_matrix *m = *mp;
    *mp = NULL;
    if (m == NULL || --m->users > 0)
        return;
    rec_cl_queue_free(&m->queue); /* which may use the buffers until now */
    for (int i = 0; i < m->levels; i++)
        level_free(m->cl, &m->level[i]);
    free(m);
}
