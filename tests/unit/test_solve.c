/* The solvers on small systems: against a dense solution, their promises, and the hard cases. */
#include "../scene.h"

#include "base/clock.h"
#include "recon/lcurve.h"

static struct scene sc;

struct system {
    struct rec_kernels k;
    struct rec_subsys *a;
    rec_solver *s;
    int cs;
    int32_t *col;
    float *b, *w, *x;
    size_t rows; /* of S */
};

/* All voxels of a ball in the middle, all cameras. */
static void system_new(struct system *y, int nch, double radius)
{
    memset(y, 0, sizeof *y);
    rec_kernels_init(&y->k, REC_CPU_ALL);
    y->cs = nch == 3 ? 4 : 1;
    y->col = pvx_calloc(sc.voxels, sizeof *y->col);
    bool present[REC_MAX_CAMERAS];
    int32_t n = 0;
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        present[c] = true;
    for (int32_t i = 0; i < (int32_t)sc.voxels; i++) {
        double p[3];
        rec_grid_centre(&sc.rig.grid, i, p);
        if (p[0] * p[0] + p[1] * p[1] + (p[2] - 0.5) * (p[2] - 0.5) < radius * radius)
            y->col[n++] = i;
    }
    if (rec_subsys_new(sc.S, &y->k, sc.pool, y->cs, &y->a) != PVX_OK ||
        rec_solver_new(sc.S, nch, &y->s) != PVX_OK)
        exit(2);
    rec_subsys_restrict(y->a, y->col, n, present);
    y->rows = y->a->row0[sc.S->n_cameras];
    y->b = pvx_calloc(y->rows * (size_t)y->cs, sizeof *y->b);
    y->w = pvx_calloc(y->rows, sizeof *y->w);
    y->x = pvx_calloc(((size_t)n + 1) * (size_t)y->cs, sizeof *y->x);
    for (size_t i = 0; i < y->rows; i++)
        y->w[i] = 1;
}
static void system_free(struct system *y)
{
    rec_solver_free(&y->s);
    rec_subsys_free(&y->a);
    free(y->col);
    free(y->b);
    free(y->w);
    free(y->x);
}
static void pictures(struct system *y, double noise)
{
    for (size_t c = 0; c < sc.rig.n_cameras; c++)
        for (size_t i = y->a->row0[c]; i < y->a->row0[c + 1]; i++)
            for (size_t l = 0; l < (size_t)y->cs; l++)
                y->b[i * (size_t)y->cs + l] =
                    l == 3 ? 0
                           : sc.image[c][(i - y->a->row0[c]) * 4 + l] + (float)(noise * t_normal());
}
static void clear(struct system *y)
{
    memset(y->x, 0, (size_t)y->a->n * (size_t)y->cs * sizeof *y->x);
}
static struct rec_solve_report solve(struct system *y, const struct rec_solve_params *p,
                                     rec_trace_fn trace, void *ctx)
{
    struct rec_solve_report r;
    T_OK(rec_solve(y->s, y->a, y->b, y->w, 0.01, p, y->x, trace, ctx, &r) == PVX_OK);
    return r;
}
static bool sound(const struct system *y)
{
    for (size_t i = 0; i < (size_t)y->a->n * (size_t)y->cs; i++)
        if (!(y->x[i] >= 0 && y->x[i] < 1e12f))
            return false;
    return true;
}

/* The minimiser of the same problem with dense matrices in double: H = A'A + lambda L L, projected
 * Gauss-Seidel, which converges for any positive definite H. */
static void dense(const struct system *y, double lambda, double *x)
{
    int32_t n = y->a->n;
    const struct rec_grid *g = &sc.rig.grid;
    double *H = pvx_calloc((size_t)n * (size_t)n, sizeof *H), *c = pvx_calloc((size_t)n, sizeof *c);
    double *row = pvx_calloc((size_t)n, sizeof *row);
    double *L = pvx_calloc((size_t)n * (size_t)n, sizeof *L);
    for (size_t i = 0; i < (size_t)y->rows; i++) {
        bool any = false;
        for (int32_t q = 0; q < n; q++) {
            row[q] = 0;
            for (uint32_t e = sc.S->colptr[y->col[q]]; e < sc.S->colptr[y->col[q] + 1]; e++)
                if (sc.S->row[e] == i)
                    row[q] = rec_sysmat_value(sc.S, e);
            any = any || row[q] != 0;
        }
        for (int32_t q = 0; any && q < n; q++) {
            if (row[q] == 0)
                continue;
            c[q] += row[q] * y->b[i * (size_t)y->cs];
            for (int32_t p = 0; p < n; p++)
                H[q * n + p] += row[q] * row[p];
        }
    }
    for (int32_t q = 0; q < n; q++)
        for (int32_t p = 0; p < n; p++) {
            int32_t u[3], v[3];
            rec_grid_ijk(g, y->col[q], u);
            rec_grid_ijk(g, y->col[p], v);
            int apart = abs(u[0] - v[0]) + abs(u[1] - v[1]) + abs(u[2] - v[2]);
            L[q * n + p] = apart == 0 ? 6 : apart == 1 ? -1 : 0;
        }
    for (int32_t q = 0; q < n; q++)
        for (int32_t k = 0; k < n; k++)
            for (int32_t p = 0; L[q * n + k] != 0 && p < n; p++)
                H[q * n + p] += lambda * L[q * n + k] * L[k * n + p];
    for (int sweep = 0; sweep < 4000; sweep++)
        for (int32_t q = 0; q < n; q++) {
            double r = c[q];
            for (int32_t p = 0; p < n; p++)
                r -= p == q ? 0 : H[q * n + p] * x[p];
            x[q] = H[q * n + q] > 0 && r > 0 ? r / H[q * n + q] : 0;
        }
    free(H);
    free(c);
    free(row);
    free(L);
}

static void pcg_is_the_dense_solution(void)
{
    struct system y;
    system_new(&y, 3, 0.25);
    pictures(&y, 0.02);
    struct rec_solve_params p = rec_solve_defaults;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 400;
    p.lambda = 0.02f;
    struct rec_solve_report r = solve(&y, &p, NULL, NULL);
    double *want = pvx_calloc((size_t)y.a->n, sizeof *want), e = 0, t = 0;
    int32_t zeros = 0;
    dense(&y, r.lambda, want);
    for (int32_t q = 0; q < y.a->n; q++) {
        double d = y.x[(size_t)q * 4] - want[q];
        e += d * d;
        t += want[q] * want[q];
        zeros += want[q] == 0;
    }
    T_OK(y.a->n > 100);
    T_OK(zeros > 0); /* the bound is active somewhere */
    T_LE(sqrt(e / t), 2e-3);
    free(want);
    system_free(&y);
}

struct fall {
    double last;
    int rises;
    uint32_t calls;
};
static void fall(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    struct fall *f = ctx;
    (void)x;
    (void)residual;
    f->rises += k > 1 && objective > f->last * (1 + 1e-6);
    f->last = objective;
    f->calls++;
}

static void pcg_never_rises(void)
{
    struct system y;
    system_new(&y, 3, 0.45);
    for (int t = 0; t < 4; t++) {
        pictures(&y, t % 2 == 0 ? 0.01 : 0.3);
        clear(&y);
        struct rec_solve_params p = rec_solve_defaults;
        p.stop = REC_STOP_ITERATIONS;
        p.iterations = 150;
        p.lambda = t < 2 ? 0.0f : 1.0f;
        struct fall f = {0};
        struct rec_solve_report r = solve(&y, &p, fall, &f);
        T_EQ_I(f.rises, 0);
        T_EQ_I(f.calls, r.iterations);
        T_OK(r.iterations > 5);
        T_NEAR(r.objective, f.last, 1e-6 * f.last);
    }
    system_free(&y);
}

static void channels_do_not_meet(void)
{
    struct system y;
    system_new(&y, 3, 0.4);
    struct rec_solve_params p = rec_solve_defaults;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 12;
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        p.solver = *name;
        pictures(&y, 0);
        clear(&y);
        solve(&y, &p, NULL, NULL);
        size_t n = (size_t)y.a->n * 4;
        float *first = pvx_calloc(n, sizeof *first);
        memcpy(first, y.x, n * sizeof *first);
        for (size_t i = 0; i < y.rows; i++) { /* another picture in the other two channels */
            y.b[i * 4 + 1] = (float)t_uniform(0, 1);
            y.b[i * 4 + 2] = 0;
        }
        clear(&y);
        solve(&y, &p, NULL, NULL);
        double d = 0, size = 0, blue = 0;
        for (size_t i = 0; i < n; i += 4) {
            d = fmax(d, fabs((double)y.x[i] - first[i]));
            size = fmax(size, first[i]);
            blue += y.x[i + 2];
        }
        T_OK(size > 0);
        T_LE(d, 1e-4 * size);
        T_EQ_I(blue > 0, 0);
        free(first);
    }
    system_free(&y);
}

static void one_channel_is_a_lane_of_three(void)
{
    struct system y1, y3;
    system_new(&y1, 1, 0.4);
    system_new(&y3, 3, 0.4);
    pictures(&y1, 0);
    pictures(&y3, 0);
    struct rec_solve_params p = rec_solve_defaults;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 12;
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        p.solver = *name;
        clear(&y1);
        clear(&y3);
        solve(&y1, &p, NULL, NULL);
        solve(&y3, &p, NULL, NULL);
        double d = 0, size = 0;
        for (size_t q = 0; q < (size_t)y1.a->n; q++) {
            d = fmax(d, fabs((double)y1.x[q] - y3.x[q * 4]));
            size = fmax(size, y1.x[q]);
        }
        T_OK(size > 0);
        T_LE(d, 1e-4 * size);
    }
    system_free(&y1);
    system_free(&y3);
}

static void stop_rules(void)
{
    struct system y;
    system_new(&y, 3, 0.45);
    pictures(&y, 0.01);
    struct rec_solve_params p = rec_solve_defaults;
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        p.solver = *name;
        p.deadline_ns = 0;
        p.iterations = 7;
        p.stop = REC_STOP_ITERATIONS;
        clear(&y);
        struct rec_solve_report r = solve(&y, &p, NULL, NULL);
        T_EQ_I(r.iterations, 7);
        T_EQ_I(r.status, REC_MAX_ITER);
        T_EQ_S(r.solver, *name);

        p.iterations = 60;
        p.stop = REC_STOP_LCURVE;
        clear(&y);
        r = solve(&y, &p, NULL, NULL);
        T_LE(r.best, r.iterations);
        T_OK(r.best > 0 && r.rel_residual < 0.5);

        p.stop = REC_STOP_DISCREPANCY; /* against a generous noise of 0.05 */
        struct rec_solve_report d;
        clear(&y);
        T_OK(rec_solve(y.s, y.a, y.b, y.w, 0.05, &p, y.x, NULL, NULL, &d) == PVX_OK);
        T_EQ_I(d.status, REC_CONVERGED);
        T_LE(d.iterations, r.iterations);
        T_OK(d.iterations < 20);

        p.stop = REC_STOP_AUTO;
        p.deadline_ns = pvx_now_mono() - 1;
        clear(&y);
        r = solve(&y, &p, NULL, NULL);
        T_EQ_I(r.status, REC_DEADLINE);
        T_EQ_I(r.iterations, 0);
        T_OK(sound(&y));
    }
    system_free(&y);
}

static void report_is_true(void)
{
    struct system y;
    system_new(&y, 3, 0.4);
    pictures(&y, 0.01);
    for (size_t i = 0; i < y.rows; i += 5)
        y.w[i] = 0; /* rows that are left out */
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report r = solve(&y, &p, NULL, NULL);
    double res = 0, norm = 0, size = 0;
    float *ax = pvx_calloc((size_t)y.a->rows * 4, sizeof *ax);
    rec_forward(y.a, y.x, ax);
    for (size_t i = 0; i < (size_t)y.a->rows; i++)
        for (size_t l = 0; l < 4; l++) {
            double b = y.b[(size_t)y.a->ray[i] * 4 + l], w = y.w[y.a->ray[i]];
            res += w * (ax[i * 4 + l] - b) * (ax[i * 4 + l] - b);
            norm += w * b * b;
        }
    for (size_t i = 0; i < (size_t)y.a->n * 4; i++)
        size += (double)y.x[i] * y.x[i];
    T_NEAR(r.residual_norm, sqrt(res), 1e-4 * sqrt(res));
    T_NEAR(r.rel_residual, sqrt(res / norm), 1e-4);
    T_NEAR(r.solution_norm, sqrt(size), 1e-4 * sqrt(size));
    free(ax);
    system_free(&y);
}

/* Whatever b is, x is finite and >= 0, also after 1000 iterations. */
static void hard_right_hand_sides(void)
{
    struct system y;
    system_new(&y, 3, 0.3);
    struct rec_solve_params p = rec_solve_defaults;
    for (const char *const *name = rec_solver_names(); *name != NULL; name++)
        for (int t = 0; t < 8; t++) {
            p.solver = *name;
            p.stop = t == 7 ? REC_STOP_ITERATIONS : REC_STOP_AUTO;
            p.iterations = t == 7 ? 1000 : 0;
            p.lambda = t == 7 ? 0 : -1;
            for (size_t i = 0; i < y.rows; i++)
                y.w[i] = 1;
            for (size_t i = 0; i < y.rows * 4; i++) {
                double v = 0;
                switch (t) {
                case 0: v = 0; break;                                 /* empty */
                case 1: v = i == y.a->ray[y.a->rows / 2] * 4u; break; /* one lit bin */
                case 2: v = 1; break;                                 /* all lit */
                case 3: v = -1; break;                                /* all below black */
                case 4: v = t_uniform(0, 1e-40); break;               /* denormal */
                case 5: v = t_uniform(0, 1e9); break;                 /* the limit of photo.h */
                case 6: v = exp(t_uniform(-14, 0)); break;            /* 10^6 dynamic range */
                case 7: v = t_normal(); break;                        /* contradiction alone */
                }
                y.b[i] = i % 4 == 3 ? 0 : (float)v;
            }
            clear(&y);
            struct rec_solve_report r = solve(&y, &p, NULL, NULL);
            T_OK(sound(&y));
            T_OK(isfinite(r.rel_residual) && isfinite(r.objective) && isfinite(r.lambda));
            if (t == 0) {
                T_EQ_I(r.status, REC_EMPTY);
                T_EQ_I(r.rel_residual > 0, 0);
            }
            if (t == 7 && p.solver == rec_solver_names()[0])
                T_LE(r.rel_residual, 1);
        }
    system_free(&y);
}

static void degenerate_systems(void)
{
    struct system y;
    struct rec_solve_params p = rec_solve_defaults;
    static const double radius[] = {0, 0.05};
    for (int t = 0; t < 2; t++) {
        system_new(&y, 3, radius[t]); /* no voxel; very few */
        if (t == 1)
            rec_subsys_restrict(y.a, y.col, 1, y.a->present);
        pictures(&y, 0.01);
        for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
            p.solver = *name;
            clear(&y);
            struct rec_solve_report r = solve(&y, &p, NULL, NULL);
            T_OK(sound(&y));
            T_EQ_I(r.status == REC_EMPTY, t == 0);
        }
        system_free(&y);
    }
    system_new(&y, 1, 0.3); /* every row left out */
    pictures(&y, 0);
    memset(y.w, 0, y.rows * sizeof *y.w);
    y.x[0] = 5;
    T_EQ_I(solve(&y, &p, NULL, NULL).status, REC_EMPTY);
    T_EQ_I(y.x[0] > 0, 0);
    p.solver = "no-such-solver";
    struct rec_solve_report r;
    T_EQ_I(rec_solve(y.s, y.a, y.b, y.w, 0, &p, y.x, NULL, NULL, &r), PVX_EINVAL);
    system_free(&y);
    rec_solver *s;
    T_EQ_I(rec_solver_new(sc.S, 2, &s), PVX_EINVAL);
}

/* Residual falls to 1e-3 while the norm hardly moves, then the norm rises at a constant residual. */
static void corner_of_an_L(void)
{
    struct rec_lcurve c = {0};
    uint32_t done = 0;
    for (uint32_t k = 1; k <= 40 && done == 0; k++) {
        double r = k <= 12 ? pow(10, -0.25 * k) : 1e-3 * (1 - 1e-3 * (k - 12));
        double x = k <= 12 ? 1 + 1e-3 * k : pow(1.3, (double)k - 12);
        (void)rec_lcurve_add(&c, k, r, x);
        if (rec_lcurve_done(&c, k, 6))
            done = k;
    }
    T_EQ_I(c.best_k, 12);
    T_EQ_I(done, 18);
    struct rec_lcurve flat = {0};
    for (uint32_t k = 1; k < 20; k++)
        T_OK(!rec_lcurve_add(&flat, k, 0, 1)); /* log 0: skipped */
    T_EQ_I(flat.best_k, 0);
}

int main(void)
{
    if (!scene_new(&sc, 5, 40, 12, 2, 2))
        return 2;
    T_RUN(corner_of_an_L);
    T_RUN(pcg_is_the_dense_solution);
    T_RUN(pcg_never_rises);
    T_RUN(channels_do_not_meet);
    T_RUN(one_channel_is_a_lane_of_three);
    T_RUN(stop_rules);
    T_RUN(report_is_true);
    T_RUN(hard_right_hand_sides);
    T_RUN(degenerate_systems);
    scene_free(&sc);
    return t_done();
}
