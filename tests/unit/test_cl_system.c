/* test_cl_system.c - frame sets on a device against the host's, to the bit: hull, columns, rows, counts, coarser levels
 * and their pictures. */
#include "tests/t.h"
#include "tests/lib/cl_bed.h"

#include "recon/matrix/active.h"
#include "recon/opencl/system.h"
#include "recon/solve/levels.c"

/* A rig whose sides are nobody's multiples; what makes frame sets of it, here and there. */
struct bed {
    struct rec_rig rig;
    pvx_pool *pool;
    rec_sysmat *S;
    struct rec_kernels k;
    int cs;
    rec_hull *hull;
    struct rec_restrictor *restrictor;
    struct rec_subsys *here, *there;
    rec_levels *levels_here, *levels_there;
    int32_t *col_here, *col_there;
    rec_cl_matrix *m;
    rec_cl_system *y;
    uint8_t *lit;
    float *b, *w, *w4;
};

static rec_cl *cl;

static void must(pvx_err e, const char *what)
{
    if (e == PVX_OK)
        return;
    printf("FAIL %s: %s\n", what, pvx_strerror(e));
    exit(1);
}

static const int32_t odd[3] = {67, 35, 50}, narrow[3] = {32, 5, 7}, tiny[3] = {9, 6, 13};

static const int32_t *sides(void)
{
    return cl_bed_is_simulated() ? narrow : odd;
}

/* A body hides a part from some cameras. */
static void put_in_the_way(struct rec_rig *r)
{
    r->bodies.body = pvx_calloc(1, sizeof *r->bodies.body);
    r->bodies.n = 1;
    r->bodies.body[0] = (struct rec_body){.kind = REC_BODY_CYLINDER,
                                          .a = {0.25, 0, r->grid.min[2]},
                                          .b = {0.25, 0, r->grid.max[2]},
                                          .radius = 0.07};
}

static void bed_rig(struct bed *k, int32_t across, enum rec_basis basis, const int32_t n[3])
{
    *k = (struct bed){.cs = 1};
    across = cl_bed_is_simulated() ? 23 : across;
    must(rec_rig_ring(cl_bed_is_simulated() ? 3 : 5, 2, across, across * 3 / 4 + 1, n[0], &k->rig),
         "rig");
    struct rec_camera *last = &k->rig.cameras[k->rig.n_cameras - 1];
    last->width = across * 4 / 5; /* another size, cut off at all sides */
    last->height = across / 2;
    last->fx *= 2;
    last->fy *= 2;
    last->cx = last->width * 0.5;
    last->cy = last->height * 0.5;
    k->rig.cameras[1].dist[0] = -0.2;
    memcpy(k->rig.grid.n, n, sizeof k->rig.grid.n);
    k->rig.grid.basis = basis;
    must(pvx_pool_new(2, "t", &k->pool), "pool");
}

/* A system on the device with room for so many columns. */
static void bed_there(struct bed *k, size_t columns)
{
    struct pvx_diag d = {""};
    rec_cl_system_free(&k->y);
    must(rec_cl_system_new(k->m, k->cs, columns, &k->y, &d), d.text);
}

/* The matrix is there. */
static void bed_new(struct bed *k, int cs)
{
    struct pvx_diag d = {""};
    size_t rows = k->S->row0[k->S->n_cameras], N = rec_grid_count(&k->S->grid);
    k->cs = cs;
    rec_kernels_init(&k->k, PVX_CPU_BEST);
    must(rec_hull_new(k->S, &k->hull), "hull");
    must(rec_restrictor_new(k->S, &k->restrictor), "restrictor");
    must(rec_subsys_new(k->S, &k->k, k->pool, cs, &k->here), "system");
    must(rec_subsys_new(k->S, &k->k, k->pool, cs, &k->there), "system");
    must(rec_levels_new(k->S, &k->k, k->pool, cs, &k->levels_here), "levels");
    must(rec_levels_new(k->S, &k->k, k->pool, cs, &k->levels_there), "levels");
    k->col_here = pvx_calloc(N, sizeof *k->col_here);
    k->col_there = pvx_calloc(N, sizeof *k->col_there);
    k->lit = pvx_calloc(rows, 1);
    k->b = pvx_calloc(rows * (size_t)cs, sizeof *k->b);
    k->w = pvx_calloc(rows, sizeof *k->w);
    k->w4 = pvx_calloc(rows * 4, sizeof *k->w4);
    must(rec_cl_matrix_new(cl, k->S, &k->m, &d), d.text);
    bed_there(k, N);
}

static void bed_free(struct bed *k)
{
    rec_cl_system_free(&k->y);
    rec_cl_matrix_free(&k->m);
    free(k->lit);
    free(k->b);
    free(k->w);
    free(k->w4);
    free(k->col_here);
    free(k->col_there);
    rec_levels_free(&k->levels_here);
    rec_levels_free(&k->levels_there);
    rec_subsys_free(&k->here);
    rec_subsys_free(&k->there);
    rec_restrictor_free(&k->restrictor);
    rec_hull_free(&k->hull);
}
static void bed_clear(struct bed *k)
{
    rec_sysmat_free(&k->S);
    rec_rig_fini(&k->rig);
    pvx_pool_free(&k->pool);
}

/* ---- frame sets ----------------------------------------------------------------------------------*/

enum shape { DARK, ALL_LIT, FLAME, SPARK, HOLES, AT_THE_EDGE, NOISE, CONTRARY, SHAPES };

static bool is_lit(const struct rec_sysmat_block *v, size_t c, enum shape shape, int32_t x,
                   int32_t y)
{
    double u = (x + 0.5) / v->bw - 0.5, t = (y + 0.5) / v->bh - 0.5;
    switch (shape) {
    case ALL_LIT: return true;
    case FLAME: return 6 * u * u + 3 * t * t < 0.3;
    case SPARK: return 6 * u * u + 3 * t * t < 0.06;
    case HOLES: return 6 * u * u + 3 * t * t < 0.3 && t_uniform(0, 1) < 0.97;
    case AT_THE_EDGE: return u < -0.2 + 0.1 * (double)c;
    case NOISE: return t_uniform(0, 1) < 0.1;
    case CONTRARY: return c % 2 == 0 ? u < -0.3 : u > 0.3;
    default: return false;
    }
}

/* Silhouettes, pictures, and weights of which some are 0 and some are 1. */
static void bed_shoot(struct bed *k, enum shape shape)
{
    static const float weight[4] = {0, 1, 1, 0.3F};
    for (size_t c = 0, i = 0; c < k->S->n_cameras; c++)
        for (int32_t y = 0; y < k->S->block[c].bh; y++)
            for (int32_t x = 0; x < k->S->block[c].bw; x++, i++) {
                k->lit[i] = is_lit(&k->S->block[c], c, shape, x, y);
                k->w[i] = weight[t_rand() % 4] * (float)t_uniform(0.5, 1);
                for (size_t l = 0; l < (size_t)k->cs; l++)
                    k->b[i * (size_t)k->cs + l] = (float)(t_normal() + 0.5);
                for (size_t l = 0; l < 4; l++)
                    k->w4[i * 4 + l] = l < 3 && t_rand() % 3 == l ? k->w[i] : 0;
            }
}

static void bed_lit(const struct bed *k, const uint8_t *lit[REC_MAX_CAMERAS])
{
    for (size_t c = 0; c < k->S->n_cameras; c++)
        lit[c] = k->lit + k->S->row0[c];
}

struct set {
    struct rec_hull_params p;
    bool present[REC_MAX_CAMERAS], per_channel;
};

static void carve_here(struct bed *k, const struct set *s, const struct rec_pictures *in,
                       const uint8_t *const *lit, struct rec_hull_kept *kept)
{
    rec_hull_carve(k->hull, &s->p, lit, s->present, k->pool, kept);
    rec_subsys_restrict(k->here, k->restrictor, kept->col, kept->n, s->present);
    if (k->levels_here != NULL)
        rec_levels_restrict(k->levels_here, k->restrictor, k->here, in);
}
static bool carve_there(struct bed *k, const struct set *s, const struct rec_pictures *in,
                        const uint8_t *const *lit, struct rec_hull_kept *kept, bool *too_many)
{
    const struct rec_cl_carving set = {
        .hull = &s->p, .lit = lit, .present = s->present, .in = in, .weight = k->w};
    bool done = rec_cl_carve(k->y, &set, kept, k->there, too_many);
    if (done && k->levels_there != NULL)
        rec_levels_restrict(k->levels_there, k->restrictor, k->there, in);
    return done;
}

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
