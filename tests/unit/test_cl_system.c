/* test_cl_system.c - frame sets on a device against the host's, to the bit: hull, columns, rows, counts, coarser levels
 * and their pictures. */
#include "recon/matrix/active.h"
#include "tests/lib/cl_system.h"

/* ---- comparisons ---------------------------------------------------------------------------------*/

static void *down(struct bed *k, const struct rec_cl_buffer *b, size_t bytes)
{
    void *to = pvx_calloc(bytes, 1);
    rec_cl_download(k->y->queue, b, 0, to, bytes);
    if (!rec_cl_wait(k->y->queue)) {
        printf("FAIL download: %s\n", rec_cl_lost(cl));
        exit(1);
    }
    return to;
}

/* Whether the device's array has these bytes. */
static bool is_there(struct bed *k, const struct rec_cl_buffer *b, const void *want, size_t bytes)
{
    void *got = down(k, b, bytes);
    bool same = memcmp(got, want, bytes) == 0;
    free(got);
    return same;
}

static int32_t neighbour(const struct rec_grid *g, const int32_t *map, int32_t v, int side)
{
    int32_t at[3];
    rec_grid_ijk(g, v, at);
    at[side / 2] += side % 2 == 0 ? -1 : 1;
    if (at[side / 2] < 0 || at[side / 2] >= g->n[side / 2])
        return -1;
    return map[rec_grid_index(g, at[0], at[1], at[2])];
}

/* map, col, near and brick that follow from the host's columns. */
static void same_columns(struct bed *k, const struct rec_cl_part *p, const struct rec_subsys *want)
{
    const struct rec_grid *g = &want->S->grid;
    size_t N = rec_grid_count(g), n = (size_t)want->n,
           bricks = rec_brick_places(g) / REC_BRICK_VOXELS;
    int32_t *map = pvx_calloc(N, sizeof *map), *near = pvx_calloc(n, sizeof *near);
    uint8_t *active = pvx_calloc(bricks, 1);
    uint32_t *brick = pvx_calloc(bricks, sizeof *brick), n_bricks = 0;
    memset(map, 0xFF, N * sizeof *map);
    for (int32_t q = 0; q < want->n; q++) {
        int32_t at[3];
        map[want->col[q]] = q;
        rec_grid_ijk(g, want->col[q], at);
        active[rec_brick_place(g, at[0], at[1], at[2]) / REC_BRICK_VOXELS] = 1;
    }
    for (uint32_t i = 0; i < bricks; i++)
        if (active[i])
            brick[n_bricks++] = i;
    T_EQ_I(p->n, want->n);
    T_EQ_I(p->bricks, n_bricks);
    T_OK(is_there(k, &p->map, map, N * sizeof *map));
    T_OK(is_there(k, &p->col, want->col, n * sizeof *want->col));
    T_OK(is_there(k, &p->brick, brick, n_bricks * sizeof *brick));
    int32_t *got = down(k, &p->near, (size_t)p->room * 6 * sizeof *got);
    for (int side = 0; side < 6; side++) {
        for (size_t q = 0; q < n; q++)
            near[q] = neighbour(g, map, want->col[q], side);
        T_EQ_I(memcmp(got + (size_t)p->room * (size_t)side, near, n * sizeof *near), 0);
    }
    free(got);
    free(map);
    free(near);
    free(active);
    free(brick);
}

/* is_row of every bin, and the tiles that have rows. */
static void same_rows(struct bed *k, const struct rec_cl_part *p, const struct rec_subsys *want)
{
    const struct rec_cl_geometry *g = &p->level->g;
    size_t rows = want->S->row0[want->S->n_cameras];
    uint8_t *row = pvx_calloc(want->win.room, 1), *active = pvx_calloc((size_t)g->all_tiles, 1);
    uint32_t *tile = pvx_calloc((size_t)g->all_tiles, sizeof *tile), tiles = 0;
    for (int32_t b = 0; b < want->n_blocks; b++)
        for (size_t i = want->block[b] * REC_ROW_BLOCK, end = i + REC_ROW_BLOCK; i < end; i++)
            row[i] = want->is_row[i] != 0;
    for (int c = 0; c < g->cameras; c++)
        for (int i = 0; i < g->camera[c].bw * g->camera[c].bh; i++) {
            const struct rec_cl_camera *v = &g->camera[c];
            int x = i % v->bw / REC_CL_TILE, y = i / v->bw / REC_CL_TILE;
            active[v->tile0 + y * v->tiles + x] |= row[v->row0 + i];
        }
    for (int i = 0; i < g->all_tiles; i++)
        if (active[i])
            tile[tiles++] = (uint32_t)i;
    uint8_t *got = down(k, &p->is_row, rows);
    for (size_t i = 0; i < rows; i++)
        got[i] = got[i] != 0;
    T_EQ_I(memcmp(got, row, rows), 0);
    T_EQ_I(p->rows, want->rows);
    T_EQ_I(p->tiles, tiles);
    T_OK(is_there(k, &p->tile, tile, tiles * sizeof *tile));
    free(got);
    free(row);
    free(active);
    free(tile);
}

/* What is on the host of a system. */
static void same_numbers(const struct rec_subsys *got, const struct rec_subsys *want)
{
    T_EQ_I(got->n, want->n);
    T_EQ_I(memcmp(got->col, want->col, (size_t)want->n * sizeof *want->col), 0);
    T_EQ_I(got->rows, want->rows);
    T_EQ_I(got->nnz, want->nnz);
    T_OK(got->sum == want->sum);
    T_OK(got->sum2 == want->sum2);
    T_EQ_I(memcmp(got->present, want->present, want->S->n_cameras * sizeof *want->present), 0);
}

/* Pictures of a coarser level: the host's in A's rows, 0 in the other bins of active tiles. */
static void same_pictures(struct bed *k, const struct rec_cl_part *p, const struct level *want,
                          bool per_channel)
{
    const struct rec_cl_geometry *g = &p->level->g;
    size_t rows = (size_t)g->rows, cs = (size_t)k->cs, ws = per_channel ? 4 : 1;
    size_t wrong = 0, weighed = 0;
    float *b = down(k, &p->b, rows * cs * sizeof *b);
    float *w = down(k, per_channel ? &p->w4 : &p->w, rows * ws * sizeof *w);
    uint8_t *row = down(k, &p->is_row, rows);
    uint32_t *tile = down(k, &p->products.tile_rows, (size_t)g->all_tiles * sizeof *tile);
    static const float zero[4];
    for (int c = 0; c < g->cameras; c++)
        for (int j = 0; j < g->camera[c].bw * g->camera[c].bh; j++) {
            const struct rec_cl_camera *v = &g->camera[c];
            int x = j % v->bw / REC_CL_TILE, y = j / v->bw / REC_CL_TILE;
            size_t i = (size_t)(v->row0 + j);
            bool is = row[i] != 0;
            if (tile[v->tile0 + y * v->tiles + x] == 0)
                continue;
            wrong += memcmp(b + i * cs, is ? want->b + i * cs : zero, cs * sizeof *b) != 0;
            wrong += memcmp(w + i * ws, is ? want->w + i * ws : zero, ws * sizeof *w) != 0;
            weighed += is && w[i * ws] > 0;
        }
    T_EQ_I(wrong, 0);
    T_OK(want->sub->n == 0 || weighed > 0);
    T_OK(p->b_here != NULL && p->w_here != NULL);
    free(b);
    free(w);
    free(row);
    free(tile);
}

static void same_levels(struct bed *k, bool per_channel)
{
    int n = k->levels_here != NULL ? k->levels_here->n : 0;
    for (int i = 0; i < n; i++) {
        const struct level *want = &k->levels_here->at[i], *got = &k->levels_there->at[i];
        const struct rec_cl_part *p = rec_cl_part_of(got->sub);
        T_OK(p == &k->y->part[i + 1]);
        same_numbers(got->sub, want->sub);
        same_columns(k, p, want->sub);
        same_rows(k, p, want->sub);
        same_pictures(k, p, want, per_channel);
        T_OK(p->b_here == got->b && p->w_here == got->w);
    }
}

/* One frame set both ways.  Returns its number of columns. */
static int32_t compare(struct bed *k, const struct set *s)
{
    const uint8_t *lit[REC_MAX_CAMERAS];
    struct rec_hull_kept here = {.col = k->col_here}, there = {.col = k->col_there};
    const struct rec_pictures in = {
        .b = k->b, .w = s->per_channel ? k->w4 : k->w, .per_channel = s->per_channel};
    bool too_many = true;
    bed_lit(k, lit);
    carve_here(k, s, &in, lit, &here);
    T_OK(carve_there(k, s, &in, lit, &there, &too_many));
    T_OK(!too_many);
    T_EQ_I(there.n, here.n);
    T_EQ_I(memcmp(there.col, here.col, (size_t)here.n * sizeof *here.col), 0);
    T_EQ_I(there.counts.inside, here.counts.inside);
    T_EQ_I(there.counts.partial, here.counts.partial);
    T_EQ_I(there.counts.outside, here.counts.outside);
    T_EQ_I(there.counts.cut, here.counts.cut);
    T_OK(k->there->card == &k->y->part[0].base);
    same_numbers(k->there, k->here);
    same_columns(k, &k->y->part[0], k->here);
    same_rows(k, &k->y->part[0], k->here);
    same_levels(k, s->per_channel);
    return here.n;
}

/* Every shape with every rule, and cameras away.  Returns the sum of columns. */
static int64_t compare_all(struct bed *k, bool per_channel)
{
    int64_t n = 0;
    for (unsigned i = cl_bed_is_simulated() ? FLAME : 0;
         i < (cl_bed_is_simulated() ? FLAME + 1 : 2 * SHAPES); i += T_SANITIZED ? 3 : 1) {
        struct set s = {.p = {.min_views = i % 5, .keep_partial = i % 3 != 1},
                        .per_channel = per_channel};
        for (size_t c = 0; c < k->S->n_cameras; c++)
            s.present[c] =
                i < SHAPES ? !cl_bed_is_simulated() || c != 1 : c != i % 5 && c != i / 2 % 5;
        bed_shoot(k, (enum shape)(i % SHAPES));
        n += compare(k, &s);
    }
    return n;
}

/* Columns, of one set after the other, that are not few. */
static int64_t some(const struct bed *k)
{
    return (int64_t)rec_grid_count(&k->S->grid) / 16;
}

/* ---- cases ---------------------------------------------------------------------------------------*/

static void bed_build(struct bed *k)
{
    struct pvx_diag d = {""};
    const struct rec_sysmat_params p = {1, 1};
    must(rec_sysmat_build(&k->rig, &p, k->pool, NULL, NULL, &k->S, &d), d.text);
}

T_CASE(boxes_of_one_channel)
{
    struct bed k;
    bed_rig(&k, 75, REC_BOX, sides());
    bed_build(&k);
    bed_new(&k, 1);
    T_LE(cl_bed_is_simulated() ? 1 : 2, k.levels_here->n);
    T_OK(compare_all(&k, false) > some(&k));
    bed_free(&k);
    bed_clear(&k);
}

T_CASE(trilinear_of_three_channels)
{
    struct bed k;
    bed_rig(&k, 93, REC_TRILINEAR, sides());
    put_in_the_way(&k.rig);
    bed_build(&k);
    bed_new(&k, 4);
    T_OK(compare_all(&k, false) > some(&k));
    T_OK(compare_all(&k, true) > some(&k)); /* mosaics */
    bed_free(&k);
    bed_clear(&k);
}

T_CASE(no_coarser_levels)
{
    struct bed k;
    bed_rig(&k, 40, REC_TRILINEAR, tiny);
    bed_build(&k);
    bed_new(&k, 1);
    T_OK(k.levels_here == NULL);
    T_OK(compare_all(&k, false) > some(&k));
    bed_free(&k);
    bed_clear(&k);
}

/* A part of S: the hull is cut where S ends. */
T_CASE(a_part_of_the_matrix)
{
    struct bed k;
    struct pvx_diag d = {""};
    const struct rec_sysmat_params p = {1, 1};
    rec_sysmat *outline;
    bed_rig(&k, 75, REC_TRILINEAR, sides());
    must(rec_sysmat_outline(&k.rig, &p, k.pool, (struct rec_progress){0}, &outline, &d), d.text);
    for (size_t i = 0; i < outline->active->bricks; i++)
        outline->active->brick[i] = t_uniform(0, 1) < 0.4;
    must(rec_sysmat_build_active(&k.rig, &outline, k.pool, (struct rec_progress){0}, &k.S, &d),
         d.text);
    bed_new(&k, 1);
    T_OK(compare_all(&k, false) > some(&k));
    bed_free(&k);
    bed_clear(&k);
}

/* Room for as many columns as a set has, and for one fewer: then the next set is whole again. */
T_CASE(no_room_for_the_columns)
{
    const struct set s = {.p = REC_HULL_DEFAULTS, .present = {true, true, true, true, true}};
    struct bed k;
    bed_rig(&k, 75, REC_BOX, sides());
    bed_build(&k);
    bed_new(&k, 1);
    bed_shoot(&k, FLAME);
    const uint8_t *lit[REC_MAX_CAMERAS];
    const struct rec_pictures in = {.b = k.b, .w = k.w};
    struct rec_hull_kept here = {.col = k.col_here}, there = {.col = k.col_there};
    bed_lit(&k, lit);
    rec_hull_carve(k.hull, &s.p, lit, s.present, k.pool, &here);
    T_OK(here.n > some(&k));
    for (int32_t fewer = cl_bed_is_simulated() ? 1 : 0; fewer < 2; fewer++) {
        bool too_many = fewer == 0;
        bed_there(&k, (size_t)(here.n - fewer));
        bed_shoot(&k, FLAME);
        T_EQ_I(carve_there(&k, &s, &in, lit, &there, &too_many), fewer == 0);
        T_EQ_I(too_many, fewer);
        T_EQ_I(k.there->card == NULL, fewer);
        bed_shoot(&k, SPARK);
        T_OK(cl_bed_is_simulated() || compare(&k, &s) > some(&k) / 8);
    }
    bed_free(&k);
    bed_clear(&k);
}

T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
