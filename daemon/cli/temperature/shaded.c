#include "daemon/cli/temperature/shaded.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define CELLS ((size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK)

pvx_err temperature_shaded_init(struct temperature_shaded *s, const struct rec_rig *rig,
                                const struct pvp_grid *g, const double kappa[3])
{
    struct rec_grid grid = {.basis = REC_TRILINEAR};
    for (int a = 0; a < 3; a++) {
        grid.n[a] = (int32_t)g->n[a];
        grid.min[a] = g->min[a];
        grid.max[a] = g->max[a];
    }
    *s = (struct temperature_shaded){.room = 0};
    rec_shade_init(&s->shade, rig, &grid, kappa);
    s->f = pvx_calloc((size_t)g->n[0] * g->n[1] * g->n[2], sizeof *s->f);
    return s->f != NULL ? PVX_OK : PVX_ENOMEM;
}

void temperature_shaded_fini(struct temperature_shaded *s)
{
    PVX_FREE(s->f);
    PVX_FREE(s->tau);
    s->room = 0;
}

struct shade_job {
    struct temperature_shaded *s;
    const struct temperature_voxels *t;
    const struct vol_volume *v;
    uint32_t nb[3];
};

/* Voxel of the grid that cell i of brick b is; -1: beyond the border. */
static int32_t voxel_of(const struct shade_job *j, size_t b, size_t i)
{
    const struct rec_grid *g = &j->s->shade.grid;
    uint32_t id = j->v->ids[b];
    int32_t x = (int32_t)(id % j->nb[0] * PVP_BRICK + i % PVP_BRICK);
    int32_t y = (int32_t)(id / j->nb[0] % j->nb[1] * PVP_BRICK + i / PVP_BRICK % PVP_BRICK);
    int32_t z = (int32_t)(id / j->nb[0] / j->nb[1] * PVP_BRICK + i / PVP_BRICK / PVP_BRICK);
    return x < g->n[0] && y < g->n[1] && z < g->n[2] ? (z * g->n[1] + y) * g->n[0] + x : -1;
}

/* The soot found last, into f. */
static void spread_soot(const struct shade_job *j, bool clear)
{
    for (size_t b = 0; b < j->v->n_bricks; b++)
        for (size_t i = 0; i < CELLS; i++) {
            int32_t at = voxel_of(j, b, i);
            float ppm = j->t->field[2][b * CELLS + i];
            if (at >= 0)
                j->s->f[at] = clear || !isfinite(ppm) ? 0 : 1e-6F * ppm;
        }
}

static void shade_brick(void *ctx, size_t b)
{
    const struct shade_job *j = ctx;
    for (size_t i = 0; i < CELLS; i++) {
        const float *e = j->v->brick + (b * CELLS + i) * 3;
        float *tau = j->s->tau + (b * CELLS + i) * 3;
        int32_t at = voxel_of(j, b, i);
        double t[3] = {1, 1, 1};
        if (at >= 0 && (e[0] != 0 || e[1] != 0 || e[2] != 0))
            rec_shade_at(&j->s->shade, j->s->f, at, t);
        for (int q = 0; q < 3; q++)
            tau[q] = (float)t[q];
    }
}

pvx_err temperature_shaded(struct temperature_shaded *s, struct temperature_voxels *t,
                           const struct vol_volume *v, struct pvx_diag *d)
{
    const struct temperature_sums before = t->sums;
    struct shade_job j = {s, t, v, {0}};
    (void)pvp_grid_bricks(&v->v.grid, j.nb);
    if (v->n_bricks > s->room) {
        PVX_FREE(s->tau);
        s->tau = pvx_calloc(v->n_bricks * CELLS * 3, sizeof *s->tau);
        PVX_NEED(s->tau);
        s->room = v->n_bricks;
    }
    t->tau = NULL;
    pvx_err e = temperature_do(t, v, d);
    for (int round = 0; round < REC_SHADE_ROUNDS && e == PVX_OK; round++) {
        spread_soot(&j, false);
        pvx_pool_run(t->pool, v->n_bricks, shade_brick, &j);
        spread_soot(&j, true); /* the next volume has other bricks */
        t->tau = s->tau;
        t->sums = before;
        e = temperature_do(t, v, d);
    }
    t->tau = NULL;
    return e;
}
