#include "recon/opencl/products.h"

#define COLUMNS(l)                                                              \
    REC_CL_BUFFER(&(l)->at), REC_CL_BUFFER(&(l)->w), REC_CL_BUFFER(&(l)->more), \
        REC_CL_BUFFER(&(l)->more_from)
#define BRICKS(a) \
    REC_CL_BUFFER(&(a)->brick), REC_CL_BUFFER(&(a)->level->store), REC_CL_BUFFER(&(a)->map)
#define ROWS(l)                                                                                    \
    REC_CL_BUFFER(&(l)->pair_brick), REC_CL_BUFFER(&(l)->pair_bins), REC_CL_BUFFER(&(l)->pair_at), \
        REC_CL_BUFFER(&(l)->rows)

pvx_err rec_cl_products_new(struct rec_cl_part *a, struct pvx_diag *d)
{
    const struct rec_cl_level *l = a->level;
    struct rec_cl_products *p = &a->products;
    rec_cl *cl = a->of->m->cl;
    size_t stored = l->stored, tiles = (size_t)l->g.all_tiles;
    size_t lanes = (size_t)a->of->cs * sizeof(float);
    *p = (struct rec_cl_products){0};
    pvx_err e = rec_cl_buffer_new(cl, stored * sizeof(uint64_t), &p->active, d);
    PVX_THEN(e, rec_cl_buffer_new(cl, tiles * sizeof(uint32_t), &p->tile_rows, d));
    PVX_THEN(e, rec_cl_buffer_new(cl, tiles * sizeof(uint32_t), &p->tile_pairs, d));
    PVX_THEN(e, rec_cl_buffer_new(cl, l->pairs * sizeof(uint32_t), &p->pair, d));
    PVX_THEN(e, rec_cl_buffer_new(cl, stored * REC_CL_GROUP * lanes, &p->x, d));
    PVX_THEN(e, rec_cl_buffer_new(cl, stored, &p->lit, d));
    if (e != PVX_OK)
        rec_cl_products_free(a);
    return e;
}

void rec_cl_products_free(struct rec_cl_part *a)
{
    struct rec_cl_products *p = &a->products;
    struct rec_cl_buffer *all[] = {&p->active, &p->tile_rows, &p->tile_pairs,
                                   &p->pair,   &p->x,         &p->lit};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        rec_cl_buffer_free(a->of->m->cl, all[i]);
}

void rec_cl_mark_rows(rec_cl_queue *q, const struct rec_cl_part *a)
{
    const struct rec_cl_level *l = a->level;
    const struct rec_cl_products *p = &a->products;
    uint64_t present = a->of->present;
    REC_CL_RUN(q, REC_CL_K_FIND_ACTIVE, 1, l->stored, REC_CL_GROUP, REC_CL_BUFFER(&l->geometry),
               REC_CL_BUFFER(&l->brick), REC_CL_BUFFER(&a->map), REC_CL_BUFFER(&p->active));
    REC_CL_RUN(q, REC_CL_K_MARK_ROWS, 1, (size_t)l->g.all_tiles, REC_CL_GROUP,
               REC_CL_BUFFER(&l->geometry), REC_CL_VALUE(present), REC_CL_BUFFER(&l->tile_from),
               ROWS(l), REC_CL_BUFFER(&p->active), REC_CL_BUFFER(&p->pair),
               REC_CL_BUFFER(&p->tile_pairs), REC_CL_BUFFER(&p->tile_rows),
               REC_CL_BUFFER(&a->is_row));
}

/* Groups of a loop over bricks, each of which takes REC_CL_FLAT voxels at a time. */
static uint32_t brick_groups(uint32_t bricks)
{
    return (uint32_t)rec_cl_groups((size_t)bricks * REC_CL_GROUP);
}

void rec_cl_count_entries(rec_cl_queue *q, const struct rec_cl_part *a, uint32_t slot,
                          uint32_t *groups)
{
    const struct rec_cl_level *l = a->level;
    uint64_t present = a->of->present;
    *groups = brick_groups(l->stored);
    REC_CL_RUN(q, REC_CL_K_COUNT_ENTRIES, 1, *groups, REC_CL_FLAT, REC_CL_BUFFER(&l->geometry),
               REC_CL_VALUE(l->stored), REC_CL_BUFFER(&a->products.active), REC_CL_VALUE(present),
               COLUMNS(l), REC_CL_BUFFER(rec_cl_parts(q)), REC_CL_VALUE(slot));
}

void rec_cl_forward(rec_cl_queue *q, const struct rec_cl_part *a, int cs,
                    const struct rec_cl_buffer *x, const struct rec_cl_buffer *y, bool add)
{
    const struct rec_cl_level *l = a->level;
    const struct rec_cl_products *p = &a->products;
    int adds = add;
    REC_CL_RUN(q, REC_CL_K_SPREAD, cs, a->bricks, REC_CL_GROUP, REC_CL_BUFFER(&l->geometry),
               BRICKS(a), REC_CL_BUFFER(x), REC_CL_BUFFER(&p->x), REC_CL_BUFFER(&p->lit));
    REC_CL_RUN(q, REC_CL_K_FORWARD, cs, a->tiles, REC_CL_FLAT, REC_CL_BUFFER(&l->geometry),
               REC_CL_BUFFER(&a->tile), REC_CL_BUFFER(&l->tile_from), REC_CL_BUFFER(&p->tile_pairs),
               REC_CL_BUFFER(&p->pair), ROWS(l), REC_CL_BUFFER(&p->x), REC_CL_BUFFER(&p->lit),
               REC_CL_BUFFER(y), REC_CL_VALUE(adds));
}

void rec_cl_adjoint(rec_cl_queue *q, const struct rec_cl_part *a, int cs,
                    const struct rec_cl_buffer *y, const struct rec_cl_buffer *x)
{
    const struct rec_cl_level *l = a->level;
    uint64_t present = a->of->present;
    REC_CL_RUN(q, REC_CL_K_ADJOINT, cs, a->bricks, REC_CL_GROUP, REC_CL_BUFFER(&l->geometry),
               BRICKS(a), REC_CL_VALUE(present), COLUMNS(l), REC_CL_BUFFER(y), REC_CL_BUFFER(x));
}

void rec_cl_column_norms(rec_cl_queue *q, const struct rec_cl_part *a,
                         const struct rec_cl_buffer *weight, const struct rec_cl_buffer *d2,
                         uint32_t slot, uint32_t *groups)
{
    const struct rec_cl_level *l = a->level;
    uint64_t present = a->of->present;
    *groups = brick_groups(a->bricks);
    REC_CL_RUN(q, REC_CL_K_COLUMN_NORMS, 1, *groups, REC_CL_FLAT, REC_CL_BUFFER(&l->geometry),
               REC_CL_VALUE(a->bricks), BRICKS(a), REC_CL_VALUE(present), COLUMNS(l),
               REC_CL_BUFFER(weight), REC_CL_BUFFER(d2), REC_CL_BUFFER(rec_cl_parts(q)),
               REC_CL_VALUE(slot));
}
