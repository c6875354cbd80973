/* test_perturb.c - perturbed solves of a small problem against the dense covariance: that of (2) in perturb.h, with V
 * of a start that fits and with a prediction, where no voxel is at its bound; the mean; a camera that is left
 * out; draws that depend on nothing but their numbers. */
#include <lapacke.h>
#include <math.h>

#include "recon/solve/impl.h"
#include "recon/solve/perturb.h"
#include "tests/lib/scene.h"
#include "tests/lib/system.h"

#define SIGMA 1e-3
#define DRAWS 600

struct small {
    struct scene scene;
    struct system y;
    rec_perturb *t;
    struct rec_perturb_fit fit[4];
    size_t n;
    float *x, *expect;
    double *H; /* [n][n] A'WA + lambda (L V L + nu) */
};

/* Column j of A and of L; rows where none is are 0. */
static void columns(const struct system *y, size_t j, float *a, float *l)
{
    size_t n = (size_t)y->a->n;
    struct rec_smooth s = {.run = pvx_calloc(n, sizeof *s.run),
                           .diag2 = pvx_calloc(n, sizeof *s.diag2)};
    struct rec_images images;
    float *unit = pvx_calloc(n + REC_SMOOTH_PAD, sizeof *unit);
    const struct rec_run *run = s.run;
    T_EQ_I(rec_images_new(y->a->S, 1, &images), PVX_OK);
    unit[j] = 1;
    rec_forward(y->a, &images, unit, a);
    rec_smooth_init(&s, &y->a->S->grid);
    rec_smooth_runs(&s, y->a, 0, (int32_t)n);
    rec_smooth_over(&s, &run, unit, 1, (struct rec_span){0, (int32_t)n}, l);
    rec_images_free(&images);
    free(s.run);
    free(s.diag2);
    free(unit);
}

static void dense(struct small *q)
{
    const struct system *y = &q->y;
    const rec_problem *pb = y->s;
    size_t n = q->n, room = y->a->win.room;
    float *a = pvx_calloc(n * room, sizeof *a), *l = pvx_calloc(n * n + REC_SMOOTH_PAD, sizeof *l);
    for (size_t j = 0; j < n; j++)
        columns(y, j, a + j * room, l + j * n);
    q->H = pvx_calloc(n * n, sizeof *q->H);
    for (size_t j = 0; j < n; j++)
        for (size_t k = 0; k < n; k++) {
            double aa = 0, ll = j == k && pb->expect != NULL ? pb->nu[0] : 0;
            for (size_t i = 0; i < y->a->row0[y->a->S->n_cameras]; i++)
                aa += (double)y->w[i] * a[j * room + i] * a[k * room + i];
            for (size_t i = 0; i < n; i++)
                ll += (double)l[j * n + i] * l[k * n + i] * (double)pb->stiff.by[i];
            q->H[j * n + k] = aa + pb->ended.lambda[0] * ll;
        }
    free(a);
    free(l);
}

/* H becomes its inverse. */
static void invert(struct small *q)
{
    lapack_int n = (lapack_int)q->n;
    T_EQ_I(LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, q->H, n), 0);
    T_EQ_I(LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', n, q->H, n), 0);
    for (size_t j = 0; j < q->n; j++)
        for (size_t k = j + 1; k < q->n; k++)
            q->H[j * q->n + k] = q->H[k * q->n + j];
}

/* A ball that glows by 1 and a little more on one side, far above its noise; weights of 1/2 and 1.  predicted: with a
 * prediction.  The start fits, so V is not 1. */
static void small_new(struct small *q, bool predicted)
{
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report r;
    struct rec_images images;
    memset(q, 0, sizeof *q);
    scene_new(&q->scene, 5, 24, 8, 2, 2);
    system_new(&q->y, &q->scene, 1, 0.4, PVX_CPU_BEST);
    struct system *y = &q->y;
    q->n = (size_t)y->a->n;
    q->x = pvx_calloc(q->n, sizeof *q->x);
    q->expect = pvx_calloc(q->n, sizeof *q->expect);
    for (size_t i = 0; i < q->n; i++)
        q->expect[i] = q->x[i] = (float)(1 + 0.5 * sin(y->col[i]));
    T_EQ_I(rec_images_new(y->a->S, 1, &images), PVX_OK);
    float *b = pvx_calloc(y->a->win.room, sizeof *b);
    rec_forward(y->a, &images, q->x, b);
    for (size_t i = 0; i < y->rows; i++) {
        y->b[i] = y->a->is_row[i] ? b[i] : 0;
        y->w[i] = i % 3 == 0 ? 0.5F : 1;
    }
    rec_images_free(&images);
    free(b);
    const struct rec_pictures in = {.b = y->b, .w = y->w, .sigma = {SIGMA, SIGMA, SIGMA, SIGMA}};
    T_OK(rec_problem_load(y->s, y->a, &in));
    rec_problem_weigh(y->s, 0.02F);
    y->s->start = REC_START_FITS;
    y->s->renewals = 1;
    if (predicted) {
        y->s->expect = q->expect;
        y->s->nu[0] = 0.5;
        y->s->keep[0] = 0.9;
    }
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 400;
    T_EQ_I(rec_solve(y->s, &p, q->x, &r), PVX_OK);
    T_EQ_I(rec_perturb_new(q->scene.S, 1, &q->t), PVX_OK);
    T_OK(rec_perturb_begin(q->t, y->s, q->x, q->fit));
}

static void small_free(struct small *q)
{
    rec_perturb_free(&q->t);
    free(q->x);
    free(q->expect);
    free(q->H);
    system_free(&q->y);
    scene_free(&q->scene);
}

static struct rec_perturbation drawn(uint32_t k)
{
    return (struct rec_perturbation){
        .seed = 7, .draw = k, .sigma = {SIGMA}, .prior = {1}, .iterations = 300};
}

/* Covariance of many draws over the dense one: voxel by voxel and of a sum of voxels; their mean. */
static void compare(bool predicted)
{
    struct small q;
    small_new(&q, predicted);
    size_t n = q.n;
    float *x = pvx_calloc(n, sizeof *x), least = 1;
    double *mean = pvx_calloc(n, sizeof *mean), *square = pvx_calloc(n, sizeof *square), sum2 = 0;
    for (uint32_t k = 0; k < DRAWS; k++) {
        struct rec_perturbation p = drawn(k);
        double sum = 0;
        rec_perturb_solve(q.t, &p, x);
        for (size_t i = 0; i < n; i++) {
            double d = (double)x[i] - q.x[i];
            least = fminf(least, x[i]);
            mean[i] += d / DRAWS;
            square[i] += d * d / DRAWS;
            sum += i % 2 == 0 ? d : 0;
        }
        sum2 += sum * sum / DRAWS;
    }
    T_OK(least > 0.1F); /* no voxel is near its bound */
    dense(&q);
    invert(&q);
    double ratio = 0, off = 0, all = 0;
    for (size_t i = 0; i < n; i++) {
        double c = SIGMA * SIGMA * q.H[i * n + i];
        T_OK(square[i] > 0.7 * c && square[i] < 1.4 * c); /* one sigma is 6 % */
        ratio += square[i] / c / (double)n;
        off += mean[i] * mean[i] / c / (double)n;
        for (size_t k = 0; k < n; k += 2)
            all += i % 2 == 0 ? SIGMA * SIGMA * q.H[i * n + k] : 0;
    }
    T_NEAR(ratio, 1, 0.03);
    T_OK(off < 2.0 / DRAWS); /* 1 / DRAWS is expected */
    T_NEAR(sum2 / all, 1, 0.25);
    free(x);
    free(mean);
    free(square);
    small_free(&q);
}
T_CASE(covariance_of_the_dense_matrix)
{
    compare(false);
}
T_CASE(covariance_with_a_prediction)
{
    compare(true);
}

/* What the fit says: sigma^2 of the evidence by its own formula; nothing moved gives the solution again. */
T_CASE(nothing_moved)
{
    struct small q;
    small_new(&q, false);
    float *x = pvx_calloc(q.n, sizeof *x);
    struct rec_perturbation p = drawn(0);
    p.sigma[0] = 0;
    T_OK(rec_perturb_solve(q.t, &p, x) >= 1);
    for (size_t i = 0; i < q.n; i++)
        T_NEAR(x[i], q.x[i], 1e-4);
    T_NEAR(q.fit[0].dark2, SIGMA * SIGMA, 1e-12);
    T_OK(q.fit[0].g > 0 && q.fit[0].g < q.fit[0].m && q.fit[0].noise2 > 0);
    free(x);
    small_free(&q);
}

/* The minimiser without camera 1, against the dense equations. */
T_CASE(a_camera_left_out)
{
    struct small q;
    small_new(&q, false);
    const struct system *y = &q.y;
    size_t n = q.n, room = y->a->win.room;
    struct rec_images images;
    float *x = pvx_calloc(n, sizeof *x), *g = pvx_calloc(n, sizeof *g);
    float *r = pvx_calloc(room, sizeof *r);
    bool out[REC_MAX_CAMERAS] = {[1] = true};
    struct rec_perturbation p = drawn(0);
    p.sigma[0] = 0;
    p.out = out;
    T_EQ_I(rec_images_new(y->a->S, 1, &images), PVX_OK);
    rec_perturb_solve(q.t, &p, x);
    dense(&q);
    rec_forward(y->a, &images, x, r);
    for (size_t i = 0; i < y->rows; i++) {
        bool in1 = i >= y->a->row0[1] && i < y->a->row0[2];
        r[i] = y->a->is_row[i] && !in1 ? y->w[i] * (r[i] - y->b[i]) : 0;
    }
    rec_adjoint_range(y->a, r, 0, (int32_t)n, g);
    double most = 0, scale = 0;
    for (size_t i = 0; i < n; i++) { /* g + lambda L V L x, from H x - A'W A x */
        double hx = 0;
        for (size_t k = 0; k < n; k++)
            hx += q.H[i * n + k] * (double)x[k];
        scale = fmax(scale, fabs(hx));
        r[0] = 0;
        g[i] += (float)hx;
    }
    rec_forward(y->a, &images, x, r);
    for (size_t i = 0; i < y->rows; i++)
        r[i] = y->a->is_row[i] ? y->w[i] * r[i] : 0;
    float *awax = pvx_calloc(n, sizeof *awax);
    rec_adjoint_range(y->a, r, 0, (int32_t)n, awax);
    for (size_t i = 0; i < n; i++)
        most = fmax(most, fabs((double)g[i] - (double)awax[i]));
    T_OK(most < 1e-4 * scale);
    rec_images_free(&images);
    free(x);
    free(g);
    free(r);
    free(awax);
    small_free(&q);
}

/* A draw is the same after another one, and another where its number or its seed is. */
T_CASE(numbers_of_draws)
{
    struct small q;
    small_new(&q, false);
    size_t bytes = q.n * sizeof(float);
    float *x[4];
    for (int i = 0; i < 4; i++)
        x[i] = pvx_calloc(q.n, sizeof *x[i]);
    struct rec_perturbation p = drawn(17);
    rec_perturb_solve(q.t, &p, x[0]);
    p.draw = 16;
    rec_perturb_solve(q.t, &p, x[1]);
    p.draw = 17;
    p.seed = 8;
    rec_perturb_solve(q.t, &p, x[2]);
    p.seed = 7;
    rec_perturb_solve(q.t, &p, x[3]);
    T_OK(memcmp(x[0], x[3], bytes) == 0);
    T_OK(memcmp(x[0], x[1], bytes) != 0 && memcmp(x[0], x[2], bytes) != 0);
    for (int i = 0; i < 4; i++)
        free(x[i]);
    small_free(&q);
}
