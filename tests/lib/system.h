/* system.h - the restricted system of a ball of the scene's voxels, seen by all cameras, with room for what is
 * solved. */
#ifndef SYSTEM_H
#define SYSTEM_H
#include "recon/matrix/subsys.h"
#include "recon/solve/problem.h"
#include "tests/lib/scene.h"
#include "tests/lib/centre.h"

struct system {
    struct rec_kernels k;
    struct rec_restrictor *r;
    struct rec_subsys *a;
    rec_problem *s;
    int cs;
    int32_t *col;
    float *b, *w, *x; /* w: 1 */
    float *w4;        /* weights per channel, the test's own */
    size_t rows;      /* of S */
};

static inline void system_new(struct system *y, const struct scene *sc, int nch, double radius,
                              unsigned cpu)
{
    bool present[REC_MAX_CAMERAS];
    int32_t n = 0;
    memset(y, 0, sizeof *y);
    memset(present, true, sizeof present);
    rec_kernels_init(&y->k, cpu);
    y->cs = nch == 3 ? 4 : 1;
    y->col = pvx_calloc(sc->voxels, sizeof *y->col);
    for (int32_t i = 0; i < (int32_t)sc->voxels; i++) {
        double p[3];
        grid_centre(&sc->rig.grid, i, p);
        if (p[0] * p[0] + p[1] * p[1] + (p[2] - 0.5) * (p[2] - 0.5) < radius * radius)
            y->col[n++] = i;
    }
    if (rec_subsys_new(sc->S, &y->k, sc->pool, y->cs, &y->a) != PVX_OK ||
        rec_restrictor_new(sc->S, &y->r) != PVX_OK || rec_problem_new(sc->S, nch, &y->s) != PVX_OK)
        exit(2);
    rec_subsys_restrict(y->a, y->r, y->col, n, present);
    y->rows = y->a->row0[sc->S->n_cameras];
    y->b = pvx_calloc(y->rows * (size_t)y->cs, sizeof *y->b);
    y->w = pvx_calloc(y->rows, sizeof *y->w);
    y->x = pvx_calloc(((size_t)n + 1) * (size_t)y->cs, sizeof *y->x);
    for (size_t i = 0; i < y->rows; i++)
        y->w[i] = 1;
}

static inline void system_free(struct system *y)
{
    rec_problem_free(&y->s);
    rec_subsys_free(&y->a);
    rec_restrictor_free(&y->r);
    free(y->col);
    free(y->b);
    free(y->w);
    free(y->w4);
    free(y->x);
}

/* The scene's pictures with Gaussian noise. */
static inline void system_pictures(struct system *y, const struct scene *sc, double noise)
{
    for (size_t c = 0; c < sc->rig.n_cameras; c++)
        for (size_t i = y->a->row0[c]; i < y->a->row0[c + 1]; i++)
            for (size_t l = 0; l < (size_t)y->cs; l++)
                y->b[i * (size_t)y->cs + l] = l == 3 ? 0
                                                     : sc->image[c][(i - y->a->row0[c]) * 4 + l] +
                                                           (float)(noise * t_normal());
}

#endif
