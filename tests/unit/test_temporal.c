/* test_temporal.c - the volume before as what is expected: the flow between two volumes, the objective and its
 * minimum against ones written out, off and after a jump as without, the same bits for any number of threads; colours,
 * one channel, Bayer pixels. */
#include <math.h>

#include "recon/solve/flow.h"
#include "recon/solve/impl.h"
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"
#include "tests/lib/system.h"

/* ---- flow ---------------------------------------------------------------------------------------*/

enum { SIDE = 32, VOXELS = SIDE * SIDE * SIDE };
static int32_t every[VOXELS];
static float ball[2][VOXELS];

/* Balls of light, the second `by` voxels further along x and half as much down z. */
static void balls(float by)
{
    for (int i = 0; i < VOXELS; i++) {
        every[i] = i;
        for (int k = 0; k < 2; k++) {
            float x = (float)(i % SIDE) - 14 - by * (float)k, y = (float)(i / SIDE % SIDE) - 16;
            float z = (float)(i / SIDE / SIDE) - 16 + 0.5f * by * (float)k;
            ball[k][i] = expf(-(x * x + y * y + z * z) / 32);
        }
    }
}

static void flow_between(unsigned threads, int32_t n, float u[3])
{
    const struct rec_grid g = {.min = {0, 0, 0}, .max = {1, 1, 1}, .n = {SIDE, SIDE, SIDE}};
    const struct rec_flow_volume from = {n, every, ball[0], 1, 1}, to = {n, every, ball[1], 1, 1};
    rec_flow *f;
    pvx_pool *pool;
    T_EQ_I(pvx_pool_new(threads, "test", &pool), PVX_OK);
    T_EQ_I(rec_flow_new(&g, &f), PVX_OK);
    rec_flow_find(f, &from, &to, pool);
    rec_flow_at(f, (const int32_t[3]){16, 16, 16}, u);
    rec_flow_free(&f);
    pvx_pool_free(&pool);
}

T_CASE_OF_THREADS(flow_follows_a_ball)
{
    for (int by = 0; by <= 4; by += 2) {
        float u[3], again[3];
        balls((float)by);
        flow_between(1, VOXELS, u);
        T_NEAR(u[0], by, 0.1 + 0.2 * by);
        T_NEAR(u[1], 0, 0.1);
        T_NEAR(u[2], -0.5 * by, 0.1 + 0.1 * by);
        flow_between(4, VOXELS, again);
        T_OK(memcmp(u, again, sizeof u) == 0);
    }
}

T_CASE(no_flow_where_nothing_burns)
{
    float u[3];
    flow_between(2, 0, u);
    for (int a = 0; a < 3; a++)
        T_OK(u[a] == 0);
}

/* ---- the objective ------------------------------------------------------------------------------*/

/* (1b) of pcg.c in double, one channel, W = V = 1. */
static double objective(struct system *y, const float *x, const float *expect, double lambda,
                        double nu)
{
    const struct rec_grid *g = &y->a->S->grid;
    double *dense = pvx_calloc(rec_grid_count(g), sizeof *dense), f = 0;
    const double a = y->s->keep[0];
    float *r = y->s->yv[0], *wr = y->s->yv[1];
    double rwr[4];
    rec_residual(y->s, x, r, wr, rwr);
    f = 0.5 * rwr[0];
    for (int32_t q = 0; q < y->a->n; q++)
        dense[y->a->col[q]] = (double)x[q] - a * (double)expect[q];
    for (int32_t q = 0; q < y->a->n; q++) {
        int32_t ijk[3], near[3];
        rec_grid_ijk(g, y->a->col[q], ijk);
        double own = dense[y->a->col[q]], lap = 6 * own;
        for (int s = 0; s < 6; s++) {
            memcpy(near, ijk, sizeof near);
            near[s / 2] += s % 2 ? 1 : -1;
            if (near[s / 2] >= 0 && near[s / 2] < g->n[s / 2])
                lap -= dense[rec_grid_index(g, near[0], near[1], near[2])];
        }
        f += 0.5 * lambda * lap * lap;
        double off = (double)x[q] - (double)expect[q];
        f += 0.5 * lambda * nu * off * off;
    }
    free(dense);
    return f;
}

T_CASE(minimum_of_the_objective)
{
    struct scene s;
    struct system y;
    scene_new(&s, 6, 36, 10, 1, 2);
    system_new(&y, &s, 1, 0.4, PVX_CPU_BEST);
    system_pictures(&y, &s, 0.02);
    float *expect = pvx_calloc((size_t)y.a->n, sizeof *expect);
    float *other = pvx_calloc((size_t)y.a->n, sizeof *other);
    const double nu = 0.7;
    for (int32_t q = 0; q < y.a->n; q++)
        expect[q] = s.truth[(size_t)y.col[q] * 3] * (float)(1 + 0.3 * t_normal());
    const struct rec_pictures in = {.b = y.b, .w = y.w, .sigma = {0.02, 0.02, 0.02, 0.02}};
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report r;
    p.lambda = 0.3f;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 200;
    T_OK(rec_problem_load(y.s, y.a, &in));
    rec_start_zero(y.s, y.x);
    y.s->expect = expect;
    y.s->nu[0] = nu;
    y.s->keep[0] = 0.9;
    T_EQ_I(rec_solve(y.s, &p, y.x, &r), PVX_OK);
    double least = objective(&y, y.x, expect, r.lambda, nu);
    T_NEAR(r.objective, least, 1e-4 * least);
    for (int way = 0; way < 40; way++) { /* any step that stays >= 0 leads up */
        double size = way % 2 ? 0.1 : 0.01;
        for (int32_t q = 0; q < y.a->n; q++) {
            float to = y.x[q] + (float)(size * t_normal()) * (y.x[q] + 0.1f);
            other[q] = to > 0 ? to : 0;
        }
        T_OK(objective(&y, other, expect, r.lambda, nu) > least * (1 - 1e-6));
    }
    /* towards what is expected, and away from it: the term itself, not only the rest */
    for (int sign = -1; sign <= 1; sign += 2) {
        for (int32_t q = 0; q < y.a->n; q++)
            other[q] = fmaxf(0, y.x[q] + (float)sign * 0.02f * (expect[q] - y.x[q]));
        T_OK(objective(&y, other, expect, r.lambda, nu) > least * (1 - 1e-6));
    }
    /* and without the term the minimum is elsewhere */
    T_OK(rec_problem_load(y.s, y.a, &in));
    rec_start_zero(y.s, other);
    T_EQ_I(rec_solve(y.s, &p, other, &r), PVX_OK);
    T_OK(objective(&y, other, expect, r.lambda, nu) > least * 1.01);
    free(expect);
    free(other);
    system_free(&y);
    scene_free(&s);
}

/* ---- frames -------------------------------------------------------------------------------------*/

enum pixels { COLOURS, BAYER, GREY };

static rec_frame *frame_new(const struct scene *s, enum pixels px, bool temporal)
{
    struct rec_frame_params p = rec_frame_defaults;
    rec_frame *f;
    p.photo.saturation = 1e30f;
    p.temporal = temporal;
    p.nch = px == GREY ? 1 : 3;
    T_EQ_I(rec_frame_alone(s->S, &s->rig, &p, s->pool, &f, NULL), PVX_OK);
    return f;
}

static void shoot(const struct scene *s, rec_frame *f, enum pixels px, double noise)
{
    if (px == GREY)
        rec_frame_reset(f);
    else
        scene_shoot(s, f, noise);
    if (px == BAYER)
        scene_filter(s, f);
    for (size_t c = 0; c < s->rig.n_cameras && px == GREY; c++) {
        size_t n = s->S->row0[c + 1] - s->S->row0[c];
        for (size_t i = 0; i < n; i++)
            rec_frame_input(f, c)[i] = s->image[c][i * 4] + (float)(noise * t_normal());
        rec_frame_camera(f, c)->present = true;
    }
}

/* The frames t0, t0 + dt, ... one after the other; error of the last, its values in *v, borrowed from a slot. */
static double follow(struct scene *s, rec_frame *f[2], enum pixels px, const double *t, int n,
                     double noise, struct rec_sparse *v)
{
    struct rec_sparse before;
    t_state = 7;
    for (int i = 0; i < n; i++) {
        rec_frame_volume(f[(i + 1) % 2], &before);
        scene_at(s, t[i]);
        shoot(s, f[i % 2], px, noise);
        rec_frame_carve(f[i % 2]);
        T_EQ_I(rec_frame_solve(f[i % 2], 0, i > 0 ? &before : NULL), PVX_OK);
    }
    rec_frame_volume(f[(n - 1) % 2], v);
    return scene_error(s, v);
}

static const double slow[] = {0.3, 0.31, 0.32, 0.33, 0.34}, jump[] = {0.3, 1.3};

T_CASE(used_where_it_moves_slowly_and_not_after_a_jump)
{
    struct scene s;
    struct rec_sparse v;
    scene_new(&s, 8, 80, 32, 1, 2);
    for (int far = 0; far < 2; far++) {
        double error[2], trust = 0;
        for (int on = 0; on < 2; on++) {
            rec_frame *f[2] = {frame_new(&s, COLOURS, on), frame_new(&s, COLOURS, on)};
            int n = far ? 2 : 5;
            error[on] = follow(&s, f, COLOURS, far ? jump : slow, n, 0.04, &v);
            trust = rec_frame_get_report(f[(n - 1) % 2])->temporal;
            if (!on)
                T_OK(trust == 0);
            rec_frame_free(&f[0]);
            rec_frame_free(&f[1]);
        }
        if (far)
            T_LE(error[1], 1.02 * error[0]);
        else
            T_LE(error[1], 1.0 * error[0]);
        T_OK(far ? trust < 0.05 : trust > 0.5);
    }
    scene_free(&s);
}

T_CASE(same_bits_without_a_volume_before)
{
    struct scene s;
    struct rec_sparse v, w;
    scene_new(&s, 6, 60, 24, 1, 2);
    rec_frame *f[2] = {frame_new(&s, COLOURS, false), NULL},
              *g[2] = {frame_new(&s, COLOURS, true), NULL};
    f[1] = f[0];
    g[1] = g[0];
    follow(&s, f, COLOURS, slow, 1, 0.05, &v);
    follow(&s, g, COLOURS, slow, 1, 0.05, &w);
    T_EQ_I(v.n, w.n);
    T_OK(memcmp(v.value, w.value, (size_t)v.n * 4 * sizeof *v.value) == 0);
    rec_frame_free(&f[0]);
    rec_frame_free(&g[0]);
    scene_free(&s);
}

/* Pixels of one channel, each camera's own or its filter's: no worse than single frames, and not by being off. */
T_CASE(one_channel_and_bayer_pixels)
{
    struct scene s;
    struct rec_sparse v;
    scene_new(&s, 8, 80, 32, 1, 2);
    for (enum pixels px = BAYER; px <= GREY; px++) {
        double error[2];
        for (int on = 0; on < 2; on++) {
            rec_frame *f[2] = {frame_new(&s, px, on), frame_new(&s, px, on)};
            error[on] = follow(&s, f, px, slow, 5, 0.05, &v);
            T_EQ_I(rec_frame_get_report(f[0])->not_finite, 0);
            T_OK((rec_frame_get_report(f[0])->temporal > 0.5) == on);
            rec_frame_free(&f[0]);
            rec_frame_free(&f[1]);
        }
        T_LE(error[1], error[0]);
    }
    scene_free(&s);
}

static void same_bits(enum pixels px)
{
    struct rec_sparse first = {0};
    rec_frame *keep[2];
    struct scene s[2];
    for (int k = 0; k < 2; k++) {
        struct rec_sparse v;
        scene_new(&s[k], 8, 80, 32, 1, k == 0 ? 1 : 4);
        rec_frame *f[2] = {frame_new(&s[k], px, true), frame_new(&s[k], px, true)};
        follow(&s[k], f, px, slow, 3, 0.04, &v);
        T_OK(rec_frame_get_report(f[0])->temporal > 0);
        if (k == 0) {
            first = v;
            memcpy(keep, f, sizeof keep);
            continue;
        }
        T_EQ_I(v.n, first.n);
        T_OK(memcmp(v.value, first.value, (size_t)v.n * (size_t)v.cs * sizeof *v.value) == 0);
        rec_frame_free(&f[0]);
        rec_frame_free(&f[1]);
    }
    rec_frame_free(&keep[0]);
    rec_frame_free(&keep[1]);
    scene_free(&s[0]);
    scene_free(&s[1]);
}

T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    for (enum pixels px = COLOURS; px <= GREY; px++)
        if (!T_TSAN || px == BAYER) /* three channels of one */
            same_bits(px);
}
