/* cl_system.h - frame sets of tests/unit/test_cl_system.c: a rig, a matrix, silhouettes and pictures of many kinds, carved
 * here and on a device. */
#ifndef TESTS_CL_SYSTEM_H
#define TESTS_CL_SYSTEM_H
#include "tests/t.h"
#include "tests/lib/cl_bed.h"

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

static inline void must(pvx_err e, const char *what)
{
    if (e == PVX_OK)
        return;
    printf("FAIL %s: %s\n", what, pvx_strerror(e));
    exit(1);
}

static const int32_t odd[3] = {67, 35, 50}, narrow[3] = {32, 5, 7}, tiny[3] = {9, 6, 13};

static inline const int32_t *sides(void)
{
    return cl_bed_is_simulated() ? narrow : odd;
}

/* A body hides a part from some cameras. */
static inline void put_in_the_way(struct rec_rig *r)
{
    r->bodies.body = pvx_calloc(1, sizeof *r->bodies.body);
    r->bodies.n = 1;
    r->bodies.body[0] = (struct rec_body){.kind = REC_BODY_CYLINDER,
                                          .a = {0.25, 0, r->grid.min[2]},
                                          .b = {0.25, 0, r->grid.max[2]},
                                          .radius = 0.07};
}

static inline void bed_rig(struct bed *k, int32_t across, enum rec_basis basis, const int32_t n[3])
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
static inline void bed_there(struct bed *k, size_t columns)
{
    struct pvx_diag d = {""};
    rec_cl_system_free(&k->y);
    must(rec_cl_system_new(k->m, k->cs, columns, &k->y, &d), d.text);
}

/* The matrix is there. */
static inline void bed_new(struct bed *k, int cs)
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

static inline void bed_free(struct bed *k)
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
static inline void bed_clear(struct bed *k)
{
    rec_sysmat_free(&k->S);
    rec_rig_fini(&k->rig);
    pvx_pool_free(&k->pool);
}

/* ---- frame sets ----------------------------------------------------------------------------------*/

enum shape { DARK, ALL_LIT, FLAME, SPARK, HOLES, AT_THE_EDGE, NOISE, CONTRARY, SHAPES };

static inline bool is_lit(const struct rec_sysmat_block *v, size_t c, enum shape shape, int32_t x,
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
static inline void bed_shoot(struct bed *k, enum shape shape)
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

static inline void bed_lit(const struct bed *k, const uint8_t *lit[REC_MAX_CAMERAS])
{
    for (size_t c = 0; c < k->S->n_cameras; c++)
        lit[c] = k->lit + k->S->row0[c];
}

struct set {
    struct rec_hull_params p;
    bool present[REC_MAX_CAMERAS], per_channel;
};

static inline void carve_here(struct bed *k, const struct set *s, const struct rec_pictures *in,
                              const uint8_t *const *lit, struct rec_hull_kept *kept)
{
    rec_hull_carve(k->hull, &s->p, lit, s->present, k->pool, kept);
    rec_subsys_restrict(k->here, k->restrictor, kept->col, kept->n, s->present);
    if (k->levels_here != NULL)
        rec_levels_restrict(k->levels_here, k->restrictor, k->here, in);
}
static inline bool carve_there(struct bed *k, const struct set *s, const struct rec_pictures *in,
                               const uint8_t *const *lit, struct rec_hull_kept *kept,
                               bool *too_many)
{
    const struct rec_cl_carving set = {
        .hull = &s->p, .lit = lit, .present = s->present, .in = in, .weight = k->w};
    bool done = rec_cl_carve(k->y, &set, kept, k->there, too_many);
    if (done && k->levels_there != NULL)
        rec_levels_restrict(k->levels_there, k->restrictor, k->there, in);
    return done;
}

#endif
