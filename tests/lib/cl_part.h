/* cl_part.h - the restricted system of some columns of one level on a device, made on the host: for tests of what works
 * with one. */
#ifndef TESTS_CL_PART_H
#define TESTS_CL_PART_H
#include "recon/opencl/products.h"
#include "tests/lib/cl_bed.h"

/* The first rows of active tiles, in number of tiles.  Returns the sum over tiles. */
static inline int32_t cl_part_tiles(rec_cl_queue *q, struct rec_cl_part *a, uint32_t *tile)
{
    size_t tiles = (size_t)a->level->g.all_tiles;
    uint32_t *rows = calloc(tiles, sizeof *rows);
    int32_t sum = 0;
    rec_cl_download(q, &a->products.tile_rows, 0, rows, tiles * sizeof *rows);
    if (!rec_cl_wait(q))
        exit(1);
    a->tiles = 0;
    for (size_t t = 0; t < tiles; t++) {
        sum += (int32_t)rows[t];
        if (rows[t] > 0)
            tile[a->tiles++] = (uint32_t)t;
    }
    free(rows);
    return sum;
}

/* Columns col [n], ascending, and the cameras that are present, bit by bit. */
struct cl_part_of {
    const int32_t *col;
    int32_t n;
    uint64_t present;
};
/* Part 0 of *y becomes their system on that level of m. */
static inline void cl_part_new(rec_cl_queue *q, rec_cl_matrix *m, int level, int cs,
                               struct cl_part_of in, rec_cl_system *y)
{
    struct pvx_diag d = {""};
    const struct rec_cl_level *l = &m->level[level];
    size_t bricks = (size_t)l->g.all_bricks, tiles = (size_t)l->g.all_tiles;
    int32_t *map = malloc((size_t)l->g.voxels * sizeof *map);
    uint32_t *brick = calloc(bricks, sizeof *brick), *tile = calloc(tiles, sizeof *tile);
    *y = (rec_cl_system){.m = m, .cs = cs, .columns = (size_t)in.n, .present = in.present};
    struct rec_cl_part *a = &y->part[0];
    *a = (struct rec_cl_part){.level = l, .of = y, .room = (uint32_t)in.n, .n = in.n};
    memset(map, 255, (size_t)l->g.voxels * sizeof *map);
    for (int32_t i = 0; i < in.n; i++) {
        int32_t v[3];
        map[in.col[i]] = i;
        rec_grid_ijk(&l->S->grid, in.col[i], v);
        brick[rec_brick_place(&l->S->grid, v[0], v[1], v[2]) / REC_BRICK_VOXELS] = 1;
    }
    for (size_t b = 0; b < bricks; b++)
        if (brick[b] != 0)
            brick[a->bricks++] = (uint32_t)b;
    a->map = cl_bed_buffer(m->cl, q, map, (size_t)l->g.voxels * sizeof *map);
    a->brick = cl_bed_buffer(m->cl, q, brick, bricks * sizeof *brick);
    a->is_row = cl_bed_buffer(m->cl, q, NULL, (size_t)l->g.room);
    if (rec_cl_products_new(a, &d) != PVX_OK) {
        printf("FAIL %s\n", d.text);
        exit(1);
    }
    rec_cl_mark_rows(q, a);
    a->rows = cl_part_tiles(q, a, tile);
    a->tile = cl_bed_buffer(m->cl, q, tile, tiles * sizeof *tile);
    free(map);
    free(brick);
    free(tile);
}

static inline void cl_part_free(rec_cl_system *y)
{
    struct rec_cl_part *a = &y->part[0];
    rec_cl_products_free(a);
    rec_cl_buffer_free(y->m->cl, &a->map);
    rec_cl_buffer_free(y->m->cl, &a->brick);
    rec_cl_buffer_free(y->m->cl, &a->is_row);
    rec_cl_buffer_free(y->m->cl, &a->tile);
}
#endif
