/* volumes.h - random sparse volumes, the same for the same seed, and whether two are one. */
#ifndef TESTS_VOLUMES_H
#define TESTS_VOLUMES_H
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/random.h"
#include "daemon/volumes/bricks.h"

struct made_volume {
    struct vol_volume v;
    struct vol_store store;
};

static inline struct pvp_start volumes_start(uint32_t nx, uint32_t ny, uint32_t nz, uint32_t nch)
{
    return (struct pvp_start){.grid = {.n = {nx, ny, nz},
                                       .min = {-0.5, 0.25, 1},
                                       .max = {0.5, 0.75, 2.5},
                                       .basis = nch == 3,
                                       .channels = nch},
                              .session = 0x1122334455667788u,
                              .rig_hash = 0x99,
                              .n_cameras = 8,
                              .fps = 20,
                              .units = "1/m",
                              .software = "pyrovoxd test"};
}

/* The volume of set `set`, exposed at t_ns, with a report; no bricks yet. */
static inline struct vol_volume volumes_empty(const struct pvp_start *s, uint64_t set, int64_t t_ns)
{
    return (struct vol_volume){.v = {.session = s->session,
                                     .set = set,
                                     .t_exposure_ns = t_ns,
                                     .t_publish_ns = t_ns + 20000000,
                                     .spread_ns = 12345,
                                     .latency_ns = 17000001,
                                     .cameras_present = 7,
                                     .camera_mask = 0x80000000000000f7u,
                                     .grid = s->grid,
                                     .report = {.status = 2,
                                                .solver = "pcg",
                                                .iterations = 11,
                                                .rel_residual = 0.0625,
                                                .active_voxels = 1234,
                                                .active_rays = 56789,
                                                .entries = 5000000000,
                                                .photometry_ns = 1000,
                                                .hull_ns = 2000,
                                                .restrict_ns = 3000,
                                                .solve_ns = 4000,
                                                .total_ns = 10000}},
                               .sample = PVP_F16};
}

/* About `share` of the bricks, values that are float16 exactly. */
static inline struct made_volume volumes_make(const struct pvp_start *s, uint64_t set, double share)
{
    uint64_t rng = pvx_mix(set + 17) | 1;
    const struct pvp_grid *g = &s->grid;
    size_t n = pvp_grid_count(g);
    float *dense = calloc(n, sizeof *dense);
    struct made_volume m = {0};
    uint32_t nb[3], all = pvp_grid_bricks(g, nb);
    unsigned char *lit = calloc(all, 1);
    if (dense == NULL || lit == NULL)
        abort();
    for (uint32_t b = 0; b < all; b++)
        lit[b] = pvx_uniform(&rng) < share;
    for (size_t i = 0; i < n; i++) {
        size_t vox = i / g->channels, x = vox % g->n[0], y = vox / g->n[0] % g->n[1];
        size_t z = vox / g->n[0] / g->n[1];
        if (lit[(z / 8 * nb[1] + y / 8) * nb[0] + x / 8] && pvx_uniform(&rng) < 0.7)
            dense[i] = (float)(pvx_random(&rng) % 2000) / 8 - 100;
    }
    if (vol_from_dense(&m.store, g, dense) != PVX_OK)
        abort();
    free(dense);
    free(lit);
    /* a number may be a date: its end gives the time */
    m.v = volumes_empty(s, set, 1767225600123456789 + (int64_t)(set % 1000000000) * 50000001);
    m.v.n_bricks = m.store.n;
    m.v.ids = m.store.ids;
    m.v.brick = m.store.brick;
    return m;
}

/* Error bars for it: modes whose values are known, and sd from them and a part of each voxel's own; owner: caller. */
static inline float *volumes_bars(struct made_volume *m, uint32_t n_modes, uint32_t doubt)
{
    const size_t n = (size_t)m->v.n_bricks * 512 * m->v.v.grid.channels;
    float *all = calloc((1 + n_modes) * n + 1, sizeof *all), *modes = all + n;
    uint64_t rng = pvx_mix(m->v.v.set + 71) | 1;
    if (all == NULL)
        abort();
    for (size_t i = 0; i < n; i++) {
        double sum = 0;
        for (uint32_t k = 0; k < n_modes && m->v.brick[i] != 0; k++) {
            modes[k * n + i] = (float)(pvx_random(&rng) % 64) / 16 - 2;
            sum += (double)modes[k * n + i] * modes[k * n + i];
        }
        const double own = (double)(1 + pvx_random(&rng) % 8) / 4;
        all[i] = m->v.brick[i] != 0 ? (float)sqrt(sum + own * own) : 0;
    }
    m->v.bars = (struct vol_bars){
        .sd = all, .n_modes = n_modes, .modes = n_modes > 0 ? modes : NULL, .doubt = doubt};
    return all;
}

static inline bool volumes_same_bars(const struct vol_volume *a, const struct vol_volume *b)
{
    const struct vol_bars *x = &a->bars, *y = &b->bars;
    const size_t n = (size_t)a->n_bricks * 512 * a->v.grid.channels * sizeof(float);
    return (x->sd == NULL) == (y->sd == NULL) &&
           (x->sd == NULL ||
            (x->doubt == y->doubt && x->n_modes == y->n_modes && memcmp(x->sd, y->sd, n) == 0 &&
             (x->n_modes == 0 || memcmp(x->modes, y->modes, n * x->n_modes) == 0)));
}

static inline bool volumes_same(const struct vol_volume *a, const struct vol_volume *b)
{
    const struct pvp_volume *x = &a->v, *y = &b->v;
    const struct pvp_report *p = &x->report, *q = &y->report;
    return x->set == y->set && x->session == y->session && x->t_exposure_ns == y->t_exposure_ns &&
           x->t_publish_ns == y->t_publish_ns && x->spread_ns == y->spread_ns &&
           x->latency_ns == y->latency_ns && x->cameras_present == y->cameras_present &&
           x->camera_mask == y->camera_mask && p->status == q->status &&
           strcmp(p->solver, q->solver) == 0 && p->iterations == q->iterations &&
           p->rel_residual == q->rel_residual && p->active_voxels == q->active_voxels &&
           p->active_rays == q->active_rays && p->entries == q->entries &&
           p->photometry_ns == q->photometry_ns && p->hull_ns == q->hull_ns &&
           p->restrict_ns == q->restrict_ns && p->solve_ns == q->solve_ns &&
           p->total_ns == q->total_ns && a->sample == b->sample && a->clamped == b->clamped &&
           a->n_bricks == b->n_bricks &&
           (a->n_bricks == 0 ||
            (memcmp(a->ids, b->ids, a->n_bricks * sizeof *a->ids) == 0 &&
             memcmp(a->brick, b->brick, a->n_bricks * sizeof *a->brick * 512 * x->grid.channels) ==
                 0));
}
#endif
