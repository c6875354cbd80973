#include "recon/opencl/hull.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define BAND 16 /* rows; kernels/hull.cl */
#define BRICK_TASKS \
    32768 /* groups that test voxels, about; they are many, because few lists are long */

static uint32_t ceil_div(size_t n, size_t by)
{
    return (uint32_t)((n + by - 1) / by);
}
static uint32_t at_most(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}
static uint32_t at_least(uint32_t a, uint32_t b)
{
    return a > b ? a : b;
}

/* ---- sizes ---------------------------------------------------------------------------------------*/

static void size_tables(struct rec_cl_hull *h, const struct rec_cl_geometry *g)
{
    for (int c = 0; c < g->cameras; c++) {
        uint32_t bw = (uint32_t)g->camera[c].bw, bh = (uint32_t)g->camera[c].bh;
        h->pad = at_least(h->pad, bw + bh + 1);
        h->high = at_least(h->high, bh);
        h->bands = at_least(h->bands, ceil_div(bh, BAND));
        h->across = at_least(h->across, ceil_div(bw, REC_CL_GROUP));
    }
    h->lists = ceil_div((size_t)g->all_bricks, REC_CL_GROUP);
    h->share = at_most(at_least(BRICK_TASKS / h->lists, 4), REC_CL_GROUP);
}

static void size_places(struct rec_cl_hull *h, const rec_cl_matrix *m)
{
    uint32_t row = 0, brick = 0;
    for (int l = 0; l < m->levels; l++) {
        const struct rec_cl_geometry *g = &m->level[l].g;
        struct rec_cl_place *p = &h->place[l];
        memcpy(p->n, g->n, sizeof p->n);
        memcpy(p->bricks, g->bricks, sizeof p->bricks);
        p->row = row;
        p->rows = (uint32_t)g->n[1] * (uint32_t)g->n[2];
        p->brick = brick;
        p->all_bricks = (uint32_t)g->all_bricks;
        row += p->rows;
        brick += p->all_bricks;
    }
}

static void size_ranges(struct rec_cl_hull *h, const rec_cl_matrix *m)
{
    for (int i = 0; i < REC_CL_COUNTED * m->levels; i++) {
        int l = i % m->levels, counted = i / m->levels;
        struct rec_cl_range *r = &h->range[i];
        r->n = counted == REC_CL_OF_ROWS     ? h->place[l].rows
               : counted == REC_CL_OF_BRICKS ? h->place[l].all_bricks
                                             : (uint32_t)m->level[l].g.all_tiles;
        r->at = h->words;
        r->group = h->groups;
        r->groups = at_most(at_least(ceil_div(r->n, REC_CL_FLAT), 1), REC_CL_FLAT);
        h->words += r->n;
        h->groups += r->groups;
    }
}

static pvx_err hull_buffers(rec_cl_system *y, struct pvx_diag *d)
{
    const rec_cl_matrix *m = y->m;
    const struct rec_cl_geometry *g = &m->level[0].g;
    struct rec_cl_hull *h = y->hull;
    const struct rec_cl_place *last = &h->place[m->levels - 1];
    const size_t word = sizeof(uint32_t), all_bricks = (size_t)last->brick + last->all_bricks;
    const size_t bricks = (size_t)g->all_bricks, rows = (size_t)g->rows,
                 cameras = (size_t)g->cameras;
    const struct {
        struct rec_cl_buffer *b;
        size_t bytes;
    } want[] = {
        {&h->places, sizeof h->place},
        {&h->ranges, sizeof h->range},
        {&h->lit, rows},
        {&h->sat, (rows + cameras * h->pad) * word},
        {&h->band, cameras * h->bands * h->across * REC_CL_GROUP * word},
        {&h->open, bricks * sizeof(uint64_t)},
        {&h->views, bricks},
        {&h->list, (size_t)h->lists * REC_CL_GROUP * word},
        {&h->listed, h->lists * word},
        {&h->mask, all_bricks * sizeof(uint64_t)},
        {&h->word, h->words * word},
        {&h->at, h->words * word},
        {&h->sums, h->groups * 4 * word},
        {&h->totals, sizeof h->total},
        {&h->entries, sizeof h->entry},
    };
    for (size_t i = 0; i < sizeof want / sizeof *want; i++)
        PVX_TRY(rec_cl_buffer_new(m->cl, want[i].bytes, want[i].b, d));
    rec_cl_upload(y->queue, &h->places, 0, h->place, sizeof h->place);
    rec_cl_upload(y->queue, &h->ranges, 0, h->range, sizeof h->range);
    return rec_cl_wait(y->queue)
               ? PVX_OK
               : pvx_fail(d, PVX_ENODEV, "%s: %s", rec_cl_about(m->cl)->name, rec_cl_lost(m->cl));
}

static size_t column_bytes(const rec_cl_system *y, int level)
{
    return y->part[level].room * sizeof(int32_t);
}

pvx_err rec_cl_hull_new(rec_cl_system *y, struct pvx_diag *d)
{
    struct rec_cl_hull *h = y->hull = pvx_calloc(1, sizeof *h);
    if (h == NULL)
        return pvx_fail(d, PVX_ENOMEM, "carving on a device: out of memory");
    size_tables(h, &y->m->level[0].g);
    size_places(h, y->m);
    size_ranges(h, y->m);
    for (int l = 1; l < y->m->levels; l++) {
        h->col[l] = pvx_reserve(column_bytes(y, l));
        if (h->col[l] == NULL)
            return pvx_fail(d, PVX_ENOMEM, "carving on a device: out of memory");
    }
    return hull_buffers(y, d);
}

void rec_cl_hull_free(rec_cl_system *y)
{
    struct rec_cl_hull *h = y->hull;
    if (h == NULL)
        return;
    struct rec_cl_buffer *const all[] = {&h->places, &h->ranges, &h->lit,  &h->sat,    &h->band,
                                         &h->open,   &h->views,  &h->list, &h->listed, &h->mask,
                                         &h->word,   &h->at,     &h->sums, &h->totals, &h->entries};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        rec_cl_buffer_free(y->m->cl, all[i]);
    for (int l = 1; l < y->m->levels; l++)
        pvx_unreserve(h->col[l], column_bytes(y, l));
    PVX_FREE(y->hull);
}

/* ---- carving -------------------------------------------------------------------------------------*/

/* The summed-area tables of the silhouettes. */
static void hull_tables(rec_cl_system *y)
{
    const struct rec_cl_hull *h = y->hull;
    const struct rec_cl_level *v = &y->m->level[0];
    size_t cameras = (size_t)v->g.cameras, parts = cameras * h->bands * h->across;
    REC_CL_RUN(y->queue, REC_CL_K_TABLE_ROWS, 1, cameras * h->high, REC_CL_GROUP,
               REC_CL_BUFFER(&v->geometry), REC_CL_VALUE(y->present), REC_CL_VALUE(h->pad),
               REC_CL_VALUE(h->high), REC_CL_BUFFER(&h->lit), REC_CL_BUFFER(&h->sat));
    REC_CL_RUN(y->queue, REC_CL_K_TABLE_BANDS, 1, parts, REC_CL_GROUP, REC_CL_BUFFER(&v->geometry),
               REC_CL_VALUE(y->present), REC_CL_VALUE(h->pad), REC_CL_VALUE(h->bands),
               REC_CL_VALUE(h->across), REC_CL_BUFFER(&h->sat), REC_CL_BUFFER(&h->band));
    REC_CL_RUN(y->queue, REC_CL_K_TABLE_COLUMNS, 1, parts, REC_CL_GROUP,
               REC_CL_BUFFER(&v->geometry), REC_CL_VALUE(y->present), REC_CL_VALUE(h->pad),
               REC_CL_VALUE(h->bands), REC_CL_VALUE(h->across), REC_CL_BUFFER(&h->sat),
               REC_CL_BUFFER(&h->band));
}

void rec_cl_hull_voxels(rec_cl_system *y, const struct rec_hull_params *p)
{
    const struct rec_cl_hull *h = y->hull;
    const struct rec_cl_level *v = &y->m->level[0];
    const cl_uint min_views = p->min_views, keep_partial = p->keep_partial != 0;
    const cl_uint need = min_views < 1 ? 1 : min_views, stored = v->stored;
    const cl_uint words = rec_cl_range_of(y, REC_CL_OF_BRICKS, 0)->at;
    hull_tables(y);
    REC_CL_RUN(y->queue, REC_CL_K_HULL_BRICKS, 1, h->lists, REC_CL_GROUP,
               REC_CL_BUFFER(&v->geometry), REC_CL_VALUE(y->present), REC_CL_VALUE(h->pad),
               REC_CL_VALUE(min_views), REC_CL_BUFFER(&v->rect), REC_CL_BUFFER(&v->store),
               REC_CL_BUFFER(&h->sat), REC_CL_BUFFER(&h->open), REC_CL_BUFFER(&h->views),
               REC_CL_BUFFER(&h->list), REC_CL_BUFFER(&h->listed), REC_CL_BUFFER(&h->mask),
               REC_CL_BUFFER(&h->word), REC_CL_VALUE(words));
    REC_CL_RUN(y->queue, REC_CL_K_HULL_VOXELS, 1, (size_t)h->lists * h->share, REC_CL_GROUP,
               REC_CL_BUFFER(&v->geometry), REC_CL_VALUE(h->pad), REC_CL_VALUE(need),
               REC_CL_VALUE(keep_partial), REC_CL_VALUE(h->share), REC_CL_VALUE(stored),
               REC_CL_BUFFER(&v->fp), REC_CL_BUFFER(&v->store), REC_CL_BUFFER(&h->sat),
               REC_CL_BUFFER(&h->open), REC_CL_BUFFER(&h->views), REC_CL_BUFFER(&h->list),
               REC_CL_BUFFER(&h->listed), REC_CL_BUFFER(&h->mask), REC_CL_BUFFER(&h->word),
               REC_CL_VALUE(words));
}
