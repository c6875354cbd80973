/* test_resolution.c - shares by Lanczos against the dense system solved, and what noise and cameras do to them. */
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>

#include "recon/check/resolution.h"
#include "tests/lib/scene.h"

enum { SIDE = 8 };

struct rig {
    struct scene s;
    struct rec_kernels k;
    struct rec_subsys *a;
    struct rec_restrictor *r;
    struct rec_images im;
    int32_t col[SIDE * SIDE * SIDE];
    int32_t n;
};

/* `cameras` of them, the voxels in a ball. */
static void rig_new(struct rig *q, size_t cameras)
{
    bool all[REC_MAX_CAMERAS];
    scene_new(&q->s, cameras, 24, SIDE, 2, 2);
    rec_kernels_init(&q->k, PVX_CPU_BEST);
    T_EQ_I(rec_subsys_new(q->s.S, &q->k, q->s.pool, 1, &q->a), PVX_OK);
    T_EQ_I(rec_restrictor_new(q->s.S, &q->r), PVX_OK);
    T_EQ_I(rec_images_new(q->s.S, 1, &q->im), PVX_OK);
    q->n = 0;
    for (int32_t i = 0; i < SIDE * SIDE * SIDE; i++) {
        double x = i % SIDE - 3.5, y = i / SIDE % SIDE - 3.5, z = i / SIDE / SIDE - 3.5;
        if (x * x + y * y + z * z < 14)
            q->col[q->n++] = i;
    }
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        all[c] = c < cameras;
    rec_subsys_restrict(q->a, q->r, q->col, q->n, all);
}

static void rig_free(struct rig *q)
{
    rec_images_free(&q->im);
    rec_restrictor_free(&q->r);
    rec_subsys_free(&q->a);
    scene_free(&q->s);
}

/* v'N (N + mu)^-1 v / v'v with N column by column. */
static double dense(struct rig *q, const float *v, double mu)
{
    size_t n = (size_t)q->n, room = q->s.S->win.room;
    double *N = pvx_calloc(n * n, sizeof *N), *z = pvx_calloc(n, sizeof *z), up = 0, down = 0;
    float *e = pvx_calloc(n, sizeof *e), *y = pvx_calloc(room, sizeof *y);
    float *column = pvx_calloc(n, sizeof *column);
    for (size_t j = 0; j < n; j++) {
        e[j] = 1;
        rec_forward(q->a, &q->im, e, y);
        rec_adjoint_range(q->a, y, 0, q->n, column);
        e[j] = 0;
        for (size_t i = 0; i < n; i++)
            N[i * n + j] = (double)column[i];
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            z[i] += N[i * n + j] * (double)v[j];
        down += (double)v[i] * (double)v[i];
    }
    for (size_t i = 0; i < n; i++)
        N[i * n + i] += mu;
    T_EQ_I(LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', (lapack_int)n, 1, N, (lapack_int)n, z, 1), 0);
    for (size_t i = 0; i < n; i++)
        up += (double)v[i] * z[i];
    free(N);
    free(z);
    free(e);
    free(y);
    free(column);
    return up / down;
}

T_CASE(shares_are_those_of_the_dense_system)
{
    static struct rig q;
    float v[SIDE * SIDE * SIDE] = {0};
    rig_new(&q, 4);
    double top = 0, least = 1, most = 0;
    for (int32_t i = 0; i < q.n; i++)
        top = fmax(top, (double)q.a->norm2[i]);
    for (int kind = 0; kind < 4; kind++) {
        const double mu[3] = {10 * top, top, 0.03 * top};
        double share[3];
        for (int32_t i = 0; i < q.n; i++)
            v[i] = kind == 0 ? 1 : kind == 1 ? (float)(i % 2) - 0.5F : (float)t_uniform(-1, 1);
        T_EQ_I(rec_resolution_share(q.a, &q.im, v, mu, 3, share), PVX_OK);
        for (int i = 0; i < 3; i++) {
            T_NEAR(share[i], dense(&q, v, mu[i]), 2e-3);
            least = fmin(least, share[i]);
            most = fmax(most, share[i]);
        }
    }
    T_OK(least < 0.2 && most > 0.9); /* not all alike */
    for (int32_t i = 0; i < q.n; i++)
        v[i] = 0;
    double one = 1, none;
    T_EQ_I(rec_resolution_share(q.a, &q.im, v, &one, 1, &none), PVX_OK);
    T_NEAR(none, 0, 0);
    rig_free(&q);
}

T_CASE(noise_costs_detail_and_cameras_bring_some)
{
    static struct rig few, many;
    struct rec_resolution r[3];
    rig_new(&few, 3);
    rig_new(&many, 9);
    double noise = 0.3 * sqrt((double)few.a->norm2[few.n / 2]);
    T_EQ_I(rec_resolution_find(few.a, &few.im, noise, &r[0]), PVX_OK);
    T_EQ_I(rec_resolution_find(few.a, &few.im, 0.1 * noise, &r[1]), PVX_OK);
    T_EQ_I(rec_resolution_find(many.a, &many.im, noise, &r[2]), PVX_OK);
    for (int axis = 0; axis < 3; axis++)
        for (int k = 0; k < REC_RESOLUTION_WAVES; k++) {
            T_OK(r[1].share[axis][0][k] >= r[0].share[axis][0][k] - 1e-6);
            T_OK(r[2].share[axis][0][k] >= r[0].share[axis][0][k] - 1e-6);
            T_OK(r[0].share[axis][1][k] >= r[0].share[axis][0][k] - 1e-6);
        }
    T_OK(r[2].share[0][0][0] > 1.2 * r[0].share[0][0][0]);
    T_OK(r[1].least[2][0] <= r[0].least[2][0] && r[1].least[2][0] > 0);
    rig_free(&few);
    rig_free(&many);
}
