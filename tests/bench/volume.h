/* volume.h - flames as the solver hands them to the publisher: sparse, stride 4, last bits as noisy as its own. */
#ifndef BENCH_VOLUME_H
#define BENCH_VOLUME_H
#include "bench.h"
#include "proto/pvp.h"

struct volume {
    struct pvp_grid grid;
    struct pvp_voxels x; /* owned */
};

static inline struct pvp_grid volume_grid(const struct rec_grid *g)
{
    struct pvp_grid out = {.channels = 3, .basis = g->basis == REC_TRILINEAR};
    for (int a = 0; a < 3; a++) {
        out.n[a] = (uint32_t)g->n[a];
        out.min[a] = g->min[a];
        out.max[a] = g->max[a];
    }
    return out;
}

/* What of a truth [z][y][x][3] glows.  Frees it. */
static inline struct volume volume_of(const struct rec_grid *g, float *truth)
{
    size_t n = rec_grid_count(g), k = 0;
    float *value = must_floats(n * 4);
    int32_t *index = pvx_calloc(n, sizeof *index);
    if (index == NULL)
        CHECK(PVX_ENOMEM);
    for (size_t i = 0; i < n; i++) {
        const float *v = truth + 3 * i;
        if (v[0] + v[1] + v[2] <= 0.01F)
            continue;
        index[k] = (int32_t)i;
        for (int c = 0; c < 3; c++) /* what a solver finds is not smooth to the last bit */
            value[4 * k + (size_t)c] = v[c] * (float)(1 + 0.02 * bench_normal());
        k++;
    }
    free(truth);
    return (struct volume){volume_grid(g), {(uint32_t)k, index, value, 4}};
}

static inline struct rec_grid volume_box(int side)
{
    return (struct rec_grid){.min = {-0.5, -0.5, 0}, .max = {0.5, 0.5, 1}, .n = {side, side, side}};
}

/* The flame of the simulated cameras at time t. */
static inline struct volume volume_ring(int side, double t)
{
    struct rec_grid g = volume_box(side);
    struct rec_flame flame;
    struct rec_flame_pose pose;
    float *truth = must_floats(rec_grid_count(&g) * 3);
    rec_flame_init(&flame, &g, 1);
    rec_flame_at(&flame, t, &pose);
    rec_flame_voxels(&pose, &g, 0, side, truth);
    return volume_of(&g, truth);
}

/* What the default solver makes of eight pictures of 8 bits: the hull's voxels, its noise, its zeros. */
static inline struct volume volume_solved(enum flame_kind kind, const int32_t size[3],
                                          pvx_pool *pool)
{
    struct scene s;
    rec_sysmat *S;
    rec_frame *f;
    struct rec_sparse v;
    if (!scene_new(&s, kind, &views_8, size, flames[kind].t, pool))
        return (struct volume){0};
    CHECK(rec_sysmat_build(&s.rig, &rec_sysmat_defaults, pool, NULL, NULL, &S, NULL));
    CHECK(rec_frame_alone(S, &s.rig, &rec_frame_defaults, pool, &f, NULL));
    scene_fill(&s, f, 0.01);
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    rec_frame_volume(f, &v);
    size_t n = (size_t)v.n, floats = n * (size_t)v.cs;
    int32_t *index = pvx_calloc(n, sizeof *index);
    float *value = must_floats(floats);
    if (index == NULL)
        CHECK(PVX_ENOMEM);
    memcpy(index, v.index, n * sizeof *index);
    memcpy(value, v.value, floats * sizeof *value);
    struct volume out = {volume_grid(v.grid), {(uint32_t)n, index, value, v.cs}};
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    scene_fini(&s);
    return out;
}

static inline double volume_lit(const struct volume *v)
{
    return 3.0 * v->x.n / (double)pvp_grid_count(&v->grid);
}

static inline void volume_free(struct volume *v)
{
    free((void *)v->x.index);
    free((void *)v->x.value);
}

/* Rows of the flame of the simulated cameras on two grids, and of what the solver makes of two.  Closes csv. */
static inline int volume_each(FILE *csv, void (*rows)(FILE *csv, const char *flame,
                                                      const struct volume *v, double bandwidth))
{
    static const int32_t size[3] = {320, 240, 128};
    pvx_pool *one, *all;
    CHECK(pvx_pool_new(1, "bench", &one));
    CHECK(pvx_pool_new(2, "bench", &all));
    double bandwidth = bench_bandwidth((size_t)96 << 20, one);
    for (int i = 0; i < 4; i++) {
        struct volume v = i < 2 ? volume_ring(64 << i, 0.3)
                                : volume_solved(i == 2 ? FLAME_RING : FLAME_POOL, size, all);
        rows(csv, i < 2 ? "ring" : i == 2 ? "ring solved" : "pool solved", &v, bandwidth);
        volume_free(&v);
    }
    pvx_pool_free(&one);
    pvx_pool_free(&all);
    fclose(csv);
    return 0;
}

#endif
