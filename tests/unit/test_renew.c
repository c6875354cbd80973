/* test_renew.c - the default solver's weights while it solves: when they change, that the objective falls in
 * between, the gate between a fault and a sharp flame, the weight from evidence against one whose degrees
 * of freedom come from the dense matrix, the same bits for any number of threads, deadlines. */
#include <math.h>

#include "base/clock.h"
#include "recon/solve/impl.h"
#include "tests/lib/scene.h"
#include "tests/lib/system.h"

static struct rec_frame_params frame_params(void)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.photo.saturation = 1e30f;
    return p;
}

#define KEPT 200
struct course {
    double objective[KEPT];
    uint32_t n;
};
static void keep(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    struct course *c = ctx;
    (void)x;
    (void)residual;
    c->objective[c->n++] = objective;
    T_EQ_I(c->n, k);
}

static bool renewed_after(const struct rec_solve_report *r, uint32_t k)
{
    bool is = false;
    for (uint32_t i = 0; i < r->renewals; i++)
        is = is || r->renewed[i] == k;
    return is;
}

/* Objective [i] is that after iteration i + 1; it may rise to the next one only where weights changed. */
T_CASE(falls_between_renewals)
{
    static const double noise[] = {0, 0.02, 0.2};
    struct scene s;
    scene_new(&s, 6, 80, 32, 1, 2);
    for (size_t t = 0; t < 6; t++) {
        struct course c = {.n = 0};
        struct rec_frame_params p = frame_params();
        rec_frame *f;
        p.solve.stop = REC_STOP_ITERATIONS;
        p.solve.iterations = 120;
        p.solve.lambda = t < 3 ? -1 : 0.5f;
        p.solve.trace = keep;
        p.solve.trace_ctx = &c;
        T_EQ_I(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
        scene_shoot(&s, f, noise[t % 3]);
        rec_frame_carve(f);
        T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
        const struct rec_solve_report *r = &rec_frame_get_report(f)->solve;
        T_OK(r->renewals >= 3 && r->renewals <= REC_RENEWALS);
        T_OK(r->renewed[0] <= 3 && r->renewed[2] <= 9);
        T_OK(c.n > r->renewed[r->renewals - 1] + 3);
        for (uint32_t k = 1; k < c.n; k++)
            T_OK(renewed_after(r, k) || c.objective[k] <= c.objective[k - 1] * (1 + 1e-6));
        T_NEAR(r->objective, c.objective[c.n - 1], 1e-6 * r->objective);
        rec_frame_free(&f);
    }
    scene_free(&s);
}

/* From zero there is nothing to renew from. */
T_CASE(a_start_that_knows_nothing)
{
    struct scene s;
    struct rec_frame_params p = frame_params();
    rec_frame *f;
    scene_new(&s, 6, 80, 32, 1, 2);
    p.coarse_start = false;
    T_EQ_I(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
    scene_shoot(&s, f, 0.02);
    rec_frame_carve(f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_get_report(f)->solve.renewals, 0);
    T_OK(rec_frame_get_report(f)->solve.iterations > 3);
    rec_frame_free(&f);
    scene_free(&s);
}

/* ---- the weight ---------------------------------------------------------------------------------*/

/* A ball of voxels, one channel, its pictures those of the flame. */
static void ball(struct scene *s, struct system *y, double noise)
{
    uint32_t seed = 1;
    scene_new(s, 6, 36, 10, 1, 2);
    system_new(y, s, 1, 0.4, PVX_CPU_BEST);
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        for (size_t i = 0; i < 36 * 27; i++) {
            seed = seed * 1664525 + 1013904223;
            double even = (double)seed / 4294967296.0 - 0.5;
            y->b[y->a->row0[c] + i] = s->image[c][i * 4] + (float)(noise * sqrt(12) * even);
        }
}

static void load_lit(struct system *y, double sigma, double shot)
{
    const struct rec_pictures in = {.b = y->b,
                                    .w = y->w,
                                    .sigma = {sigma, sigma, sigma, sigma},
                                    .shot = {shot, shot, shot, shot}};
    T_OK(rec_problem_load(y->s, y->a, &in));
    rec_problem_weigh(y->s, -1);
}

static void load(struct system *y, double sigma)
{
    load_lit(y, sigma, 0);
}

/* Where the noise of light is known the weight begins higher, and does not fall before the misfit is above
 * all of the noise, not that of the dark alone. */
T_CASE(noise_of_light)
{
    struct scene s;
    struct system y;
    const double sigma = 0.02, shot = 0.006, penalty[4] = {1e3}, lit[4] = {1e-6};
    ball(&s, &y, sigma);
    rec_problem *pb = y.s;
    load(&y, sigma);
    double dark = pb->noise2[0], formula = pb->formula[0];
    load_lit(&y, sigma, shot);
    double mean = pb->light[0] / y.a->rows, all = sigma * sigma + shot * mean;
    T_LE(2 * sigma * sigma, all); /* or it would not be seen here */
    T_NEAR(pb->noise2[0] - dark, shot * mean, 0.03 * shot * mean);
    T_LE(1.2 * formula, pb->formula[0]);
    for (int known = 0; known < 2; known++)
        for (int above = 0; above < 2; above++) {
            load_lit(&y, sigma, known ? shot : 0);
            double lambda[4], rwr[4] = {pb->m * all * (above ? 1.15 : 1.05)};
            memcpy(lambda, pb->formula, sizeof lambda);
            rec_problem_reweigh(pb, rwr, penalty, lit, lambda);
            T_EQ_I(lambda[0] < pb->formula[0], !known || above);
        }
    system_free(&y);
    scene_free(&s);
}

T_CASE(fault_keeps_what_the_misfit_raised)
{
    struct scene s;
    struct system y;
    ball(&s, &y, 0.02);
    load(&y, 0.02);
    rec_problem *pb = y.s;
    const double misses[4] = {7 * pb->noise2[0]}, penalty[4] = {1e-3}, lit[4] = {400};
    double formula = pb->formula[0], noise = pb->m * pb->noise2[0], lambda[4];
    T_OK(formula > 0 && noise > 0);
    T_NEAR(pb->lambda[0], formula, 0);
    rec_problem_misfit(pb, misses);
    T_NEAR(pb->lambda[0], 7 * formula, 1e-9 * formula);
    T_NEAR(pb->formula[0], formula, 0);

    memcpy(lambda, pb->lambda, sizeof lambda); /* the fine grid misses as much: it stays */
    rec_problem_reweigh(pb, (double[4]){26 * noise}, penalty, lit, lambda);
    T_NEAR(lambda[0], 7 * formula, 1e-9 * formula);
    rec_problem_reweigh(pb, (double[4]){24 * noise}, penalty, lit, lambda); /* it does not */
    T_LE(lambda[0], 4 * formula);

    static const struct { /* and never leaves its bounds */
        double rwr, penalty, lit;
    } odd[] = {{0, 1, 400}, {1e-30, 1e30, 400}, {1, 0, 400}, {1, 1e-30, 400},
               {0, 0, 0},   {1, 1, 0},          {1, 1, 1e9}, {NAN, 1, 400}};
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
        memcpy(lambda, pb->formula, sizeof lambda);
        rec_problem_reweigh(pb, (double[4]){odd[i].rwr * noise}, (double[4]){odd[i].penalty},
                            (double[4]){odd[i].lit}, lambda);
        T_OK(lambda[0] >= 0.0199 * formula && lambda[0] <= 4.01 * formula);
    }

    rec_problem_load(pb, y.a,
                     &(struct rec_pictures){.b = y.b, .w = y.w, .sigma = {0.02, 0.02, 0.02, 0.02}});
    rec_problem_weigh(pb, 2); /* what somebody asked for is left alone */
    memcpy(lambda, pb->lambda, sizeof lambda);
    rec_problem_misfit(pb, misses);
    rec_problem_reweigh(pb, (double[4]){noise}, penalty, lit, lambda);
    T_NEAR(lambda[0], pb->formula[0], 0);
    T_NEAR(pb->lambda[0], pb->formula[0], 0);
    system_free(&y);
    scene_free(&s);
}

/* Columns of A and L as dense arrays: A'A and L'L, [n][n]. */
static void dense(const struct system *y, double *AA, double *LL)
{
    size_t n = (size_t)y->a->n, m = (size_t)y->a->rows, room = y->a->win.room;
    struct rec_images images;
    struct rec_smooth s = {.run = pvx_calloc(n, sizeof *s.run),
                           .diag2 = pvx_calloc(n, sizeof *s.diag2)};
    float *lap = pvx_calloc(n + REC_SMOOTH_PAD, sizeof *lap);
    float *unit = pvx_calloc(n, sizeof *unit), *a = pvx_calloc(n * m, sizeof *a);
    float *bins = pvx_calloc(room, sizeof *bins);
    double *l = pvx_calloc(n * n, sizeof *l);
    T_EQ_I(rec_images_new(y->a->S, 1, &images), PVX_OK);
    rec_smooth_init(&s, &y->a->S->grid);
    rec_smooth_runs(&s, y->a, 0, (int32_t)n);
    for (size_t j = 0; j < n; j++) {
        unit[j] = 1;
        rec_forward(y->a, &images, unit, bins);
        for (size_t i = 0, row = 0; i < y->a->row0[y->a->S->n_cameras]; i++)
            if (y->a->is_row[i])
                a[j * m + row++] = bins[i];
        const struct rec_run *run = s.run;
        rec_smooth_over(&s, &run, unit, 1, (struct rec_span){0, (int32_t)n}, lap);
        for (size_t i = 0; i < n; i++)
            l[j * n + i] = lap[i];
        unit[j] = 0;
    }
    for (size_t j = 0; j < n; j++)
        for (size_t k = 0; k <= j; k++) {
            double aa = 0, ll = 0;
            for (size_t i = 0; i < m; i++)
                aa += (double)a[j * m + i] * a[k * m + i];
            for (size_t i = 0; i < n; i++)
                ll += l[j * n + i] * l[k * n + i];
            AA[j * n + k] = AA[k * n + j] = aa;
            LL[j * n + k] = LL[k * n + j] = ll;
        }
    rec_images_free(&images);
    free(s.run);
    free(s.diag2);
    free(lap);
    free(unit);
    free(bins);
    free(a);
    free(l);
}

/* tr (P + lambda Q)^-1 P by Cholesky, columns of P one after the other; x = (P + lambda Q)^-1 b too. */
static double trace_of(const double *P, const double *Q, double lambda, size_t n, double *x)
{
    double *h = pvx_calloc(n * n, sizeof *h), *v = pvx_calloc(n, sizeof *v), sum = 0;
    for (size_t j = 0; j < n; j++)
        for (size_t i = j; i < n; i++) {
            double s = P[i * n + j] + lambda * Q[i * n + j];
            for (size_t k = 0; k < j; k++)
                s -= h[i * n + k] * h[j * n + k];
            h[i * n + j] = i == j ? sqrt(s) : s / h[j * n + j];
        }
    for (size_t c = 0; c <= n; c++) {
        for (size_t i = 0; i < n; i++)
            v[i] = c < n ? P[i * n + c] : x[i];
        for (size_t i = 0; i < n; i++) {
            for (size_t k = 0; k < i; k++)
                v[i] -= h[i * n + k] * v[k];
            v[i] /= h[i * n + i];
        }
        for (size_t i = n; i-- > 0;) {
            for (size_t k = i + 1; k < n; k++)
                v[i] -= h[k * n + i] * v[k];
            v[i] /= h[i * n + i];
        }
        if (c < n)
            sum += v[c];
        else
            memcpy(x, v, n * sizeof *v);
    }
    free(h);
    free(v);
    return sum;
}

/* The least of the objective without its bound, where all columns count, V = 1: degrees of freedom and
 * weight against the dense matrix. */
T_CASE(evidence_is_near_that_of_the_dense_matrix)
{
    struct scene s;
    struct system y;
    ball(&s, &y, 0.02);
    load(&y, 0.02);
    rec_problem *pb = y.s;
    size_t n = (size_t)y.a->n, m = (size_t)y.a->rows;
    double *AA = pvx_calloc(n * n, sizeof *AA), *LL = pvx_calloc(n * n, sizeof *LL);
    double *Ab = pvx_calloc(n, sizeof *Ab), *x = pvx_calloc(n, sizeof *x), bb = 0;
    float *column = pvx_calloc(n, sizeof *column);
    dense(&y, AA, LL);
    rec_adjoint_range(y.a, pb->b, 0, (int32_t)n, column);
    for (size_t i = 0; i < n; i++)
        Ab[i] = column[i];
    for (size_t i = 0; i < y.a->win.room; i++) /* 0 where there is no row */
        bb += (double)pb->b[i] * pb->b[i];
    for (double rel = 0.02; rel < 30; rel *= 36) {
        double lambda = rel * pb->unit[0], xAAx = 0, xLLx = 0, xAb = 0;
        memcpy(x, Ab, n * sizeof *x);
        double g = trace_of(AA, LL, lambda, n, x);
        for (size_t i = 0; i < n; i++) {
            for (size_t k = 0; k < n; k++) {
                xAAx += x[i] * AA[i * n + k] * x[k];
                xLLx += x[i] * LL[i * n + k] * x[k];
            }
            xAb += x[i] * Ab[i];
        }
        double rr = xAAx - 2 * xAb + bb, exact = rr / ((double)m - g) * g / xLLx;
        double now[4] = {lambda};
        pb->formula[0] = 2 * exact; /* out of the way of its bounds */
        rec_problem_reweigh(pb, (double[4]){rr}, (double[4]){xLLx}, (double[4]){(double)n}, now);
        double asked = pb->formula[0] * pow(now[0] / pb->formula[0], 1 / 1.6) / 1.5;
        printf(
            "  lambda %.3g of the mean diagonal: %.1f of %zu degrees of freedom; evidence %.3g of "
            "the exact one\n",
            rel, g, n, asked / exact);
        T_OK(asked > exact / 2 && asked < exact * 2);
    }
    free(AA);
    free(LL);
    free(Ab);
    free(x);
    free(column);
    system_free(&y);
    scene_free(&s);
}

/* ---- whole frames -------------------------------------------------------------------------------*/

T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    static const unsigned threads[] = {1, 2, 5};
    float *first = NULL;
    for (size_t t = 0; t < 3; t++) {
        struct scene s;
        struct rec_frame_params p = frame_params();
        struct rec_sparse v;
        rec_frame *f;
        scene_new(&s, 6, 80, 32, 1, threads[t]);
        T_EQ_I(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
        scene_shoot(&s, f, 0);
        rec_frame_carve(f);
        T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
        T_OK(rec_frame_get_report(f)->solve.renewals > 0);
        rec_frame_volume(f, &v);
        size_t bytes = (size_t)v.n * (size_t)v.cs * sizeof *v.value;
        if (first == NULL) {
            first = pvx_calloc(bytes, 1);
            memcpy(first, v.value, bytes);
        } else {
            T_OK(memcmp(first, v.value, bytes) == 0);
        }
        rec_frame_free(&f);
        scene_free(&s);
    }
    free(first);
}

/* Wherever a deadline falls, also between an iteration and a renewal. */
T_CASE(deadlines_fall_anywhere)
{
    struct scene s;
    struct rec_frame_params p = frame_params();
    struct rec_sparse v;
    rec_frame *f;
    scene_new(&s, 6, 80, 32, 1, 2);
    T_EQ_I(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
    scene_shoot(&s, f, 0.02);
    rec_frame_carve(f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    int64_t whole = rec_frame_get_report(f)->solve_ns;
    for (int i = 1; i <= 20; i++) {
        T_EQ_I(rec_frame_solve(f, pvx_now_mono() + i * whole / 20, NULL), PVX_OK);
        const struct rec_solve_report *r = &rec_frame_get_report(f)->solve;
        rec_frame_volume(f, &v);
        bool sound = isfinite(r->objective) && isfinite(r->lambda) && isfinite(r->rel_residual);
        for (int32_t k = 0; k < v.n * v.cs; k++)
            sound = sound && v.value[k] >= 0 && v.value[k] < 1e6f;
        T_OK(sound);
        T_OK(r->renewals <= r->iterations);
    }
    rec_frame_free(&f);
    scene_free(&s);
}

/* A larger tolerance ends sooner, and x moves on by less than a smaller one. */
T_CASE(stops_when_it_stands_still)
{
    uint32_t last = 0;
    struct scene s;
    scene_new(&s, 6, 80, 32, 1, 2);
    for (float tolerance = 0.1f; tolerance > 1e-4f; tolerance /= 10) {
        struct rec_frame_params p = frame_params();
        rec_frame *f;
        p.solve.tolerance = tolerance;
        T_EQ_I(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
        scene_shoot(&s, f, 0);
        rec_frame_carve(f);
        T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
        T_OK(rec_frame_get_report(f)->solve.iterations > last);
        last = rec_frame_get_report(f)->solve.iterations;
        rec_frame_free(&f);
    }
    scene_free(&s);
}
