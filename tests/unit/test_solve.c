/* The solvers on small systems: against a dense solution, their promises, and the hard cases. */
#include "../scene.h"

#include "base/clock.h"

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
        if (strcmp(*name, "sirt") == 0 || strcmp(*name, "fista") == 0 ||
            strcmp(*name, "mrnsd") == 0) /* the objective is that of the iterate returned */
            T_NEAR(r.objective, 0.5 * r.residual_norm * r.residual_norm, 1e-4 * r.objective);

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

/* ---- against the formulas, with dense matrices in double ----------------------------------------- */

enum { KEEP = 4 }; /* iterations compared */

struct model {
    const struct system *y;
    size_t m, n;
    double *A, *b, *w, *x;              /* [m][n], [m], [m], [n], of channel 0 */
    double *g, *s, *r, *c;              /* work areas */
    size_t camera[REC_MAX_CAMERAS + 1]; /* first row of each */
};

static double *doubles(size_t n)
{
    double *p = pvx_calloc(n, sizeof *p);
    if (p == NULL)
        exit(2);
    return p;
}

static void model_new(struct model *d, const struct system *y)
{
    const struct rec_packed *g = &y->a->by_row;
    *d = (struct model){.y = y, .m = (size_t)y->a->rows, .n = (size_t)y->a->n};
    d->A = doubles(d->m * d->n);
    d->b = doubles(d->m);
    d->w = doubles(d->m);
    d->x = doubles(d->n);
    d->g = doubles(d->n);
    d->s = doubles(d->n);
    d->r = doubles(d->m);
    d->c = doubles(d->n);
    for (size_t i = 0, cam = 0; i < d->m; i++) {
        for (uint32_t e = g->ptr[i]; e < g->ptr[i + 1]; e++)
            d->A[i * d->n + rec_packed_index(g, e)] += (double)rec_packed_value(g, e);
        d->b[i] = y->b[y->a->ray[i] * (size_t)y->cs];
        d->w[i] = y->w[y->a->ray[i]];
        while (y->a->ray[i] >= y->a->row0[cam + 1])
            d->camera[++cam] = i;
        d->camera[cam + 1] = d->m;
    }
}
static void model_free(struct model *d)
{
    free(d->A);
    free(d->b);
    free(d->w);
    free(d->x);
    free(d->g);
    free(d->s);
    free(d->r);
    free(d->c);
}
static void times(const struct model *d, const double *x, double *out)
{
    for (size_t i = 0; i < d->m; i++) {
        out[i] = 0;
        for (size_t q = 0; q < d->n; q++)
            out[i] += d->A[i * d->n + q] * x[q];
    }
}
/* out = A'W r over rows [i0, i1). */
static void adjoint(const struct model *d, const double *r, size_t i0, size_t i1, double *out)
{
    for (size_t q = 0; q < d->n; q++)
        out[q] = 0;
    for (size_t i = i0; i < i1; i++)
        for (size_t q = 0; q < d->n; q++)
            out[q] += d->A[i * d->n + q] * d->w[i] * r[i];
}
static double weighted(const struct model *d, const double *u, const double *v)
{
    double s = 0;
    for (size_t i = 0; i < d->m; i++)
        s += d->w[i] * u[i] * v[i];
    return s;
}
static double inner(const struct model *d, const double *u, const double *v)
{
    double s = 0;
    for (size_t q = 0; q < d->n; q++)
        s += u[q] * v[q];
    return s;
}
static void all_ones(double *v, size_t n)
{
    for (size_t i = 0; i < n; i++)
        v[i] = 1;
}
/* The uniform volume with the light of the images. */
static void uniform(struct model *d)
{
    double light = 0, weight = 0;
    all_ones(d->r, d->m);
    adjoint(d, d->r, 0, d->m, d->c);
    for (size_t q = 0; q < d->n; q++)
        weight += d->c[q];
    for (size_t i = 0; i < d->m; i++)
        light += d->w[i] * fmax(d->b[i], 0);
    for (size_t q = 0; q < d->n; q++)
        d->x[q] = d->c[q] > 0 ? light / weight : 0;
}

static void model_em(struct model *d, size_t subsets)
{
    double *sens = doubles(d->n);
    size_t cameras = d->y->a->S->n_cameras;
    uniform(d);
    for (int k = 0; k < KEEP; k++)
        for (size_t s = 0; s < subsets; s++) {
            size_t i0 = d->camera[s * cameras / subsets];
            size_t i1 = d->camera[(s + 1) * cameras / subsets];
            all_ones(d->r, d->m);
            adjoint(d, d->r, i0, i1, sens);
            times(d, d->x, d->r);
            for (size_t i = 0; i < d->m; i++)
                d->r[i] = d->r[i] > 0 ? fmax(d->b[i], 0) / d->r[i] : 0;
            adjoint(d, d->r, i0, i1, d->g);
            for (size_t q = 0; q < d->n; q++)
                d->x[q] *= sens[q] > 0 ? d->g[q] / sens[q] : 1;
        }
    free(sens);
}
static void model_mlem(struct model *d)
{
    model_em(d, 1);
}
static void model_osem(struct model *d)
{
    model_em(d, d->y->a->S->n_cameras / 2);
}

/* (1) of solve_sirt.c; with momentum (2), restarted when the step turns back. */
static void model_gradient(struct model *d, bool momentum)
{
    double *old = doubles(d->n), *yk = doubles(d->n), age = 1;
    all_ones(d->s, d->n);
    times(d, d->s, d->r);
    adjoint(d, d->r, 0, d->m, d->c);
    for (int k = 0; k < KEEP; k++) {
        times(d, yk, d->r);
        for (size_t i = 0; i < d->m; i++)
            d->r[i] -= d->b[i];
        adjoint(d, d->r, 0, d->m, d->g);
        double back = 0;
        for (size_t q = 0; q < d->n; q++) {
            old[q] = d->x[q];
            d->x[q] = d->c[q] > 0 ? fmax(0, yk[q] - d->g[q] / d->c[q]) : 0;
            back += (yk[q] - d->x[q]) * d->c[q] * (d->x[q] - old[q]);
        }
        age = back > 0 ? 1 : age;
        double next = (1 + sqrt(1 + 4 * age * age)) / 2;
        for (size_t q = 0; q < d->n; q++)
            yk[q] = d->x[q] + (momentum ? (age - 1) / next * (d->x[q] - old[q]) : 0);
        age = next;
    }
    free(old);
    free(yk);
}
static void model_sirt(struct model *d)
{
    model_gradient(d, false);
}
static void model_fista(struct model *d)
{
    model_gradient(d, true);
}

static void model_mrnsd(struct model *d)
{
    double *as = doubles(d->m);
    uniform(d); /* c = column sums */
    for (int k = 0; k < KEEP; k++) {
        double steepest = 0;
        times(d, d->x, d->r);
        for (size_t i = 0; i < d->m; i++)
            d->r[i] -= d->b[i];
        adjoint(d, d->r, 0, d->m, d->g);
        for (size_t q = 0; q < d->n; q++) {
            d->s[q] = d->c[q] > 0 ? -d->x[q] * d->g[q] / d->c[q] : 0;
            if (d->c[q] > 0 && d->x[q] > 0)
                steepest = fmax(steepest, d->g[q] / d->c[q]);
        }
        times(d, d->s, as);
        double alpha = -inner(d, d->g, d->s) / weighted(d, as, as);
        alpha = alpha * steepest > 1 ? 1 / steepest : alpha;
        for (size_t q = 0; q < d->n; q++)
            d->x[q] = fmax(0, d->x[q] + alpha * d->s[q]);
    }
    free(as);
}

static void model_conjugate(struct model *d, bool clip)
{
    double *ad = doubles(d->m);
    memcpy(d->r, d->b, d->m * sizeof *d->r);
    adjoint(d, d->r, 0, d->m, d->s);
    memcpy(d->g, d->s, d->n * sizeof *d->g);
    double gamma = inner(d, d->s, d->s);
    for (int k = 0; k < KEEP; k++) {
        times(d, d->g, ad);
        double alpha = gamma / weighted(d, ad, ad);
        for (size_t q = 0; q < d->n; q++) {
            d->x[q] += alpha * d->g[q];
            d->x[q] = clip ? fmax(0, d->x[q]) : d->x[q];
        }
        for (size_t i = 0; i < d->m; i++)
            d->r[i] -= alpha * ad[i];
        adjoint(d, d->r, 0, d->m, d->s);
        double next = inner(d, d->s, d->s);
        for (size_t q = 0; q < d->n; q++)
            d->g[q] = d->s[q] + next / gamma * d->g[q];
        gamma = next;
    }
    for (size_t q = 0; q < d->n; q++)
        d->x[q] = fmax(0, d->x[q]);
    free(ad);
}
static void model_cgls(struct model *d)
{
    model_conjugate(d, false);
}
static void model_cgls_paper(struct model *d)
{
    model_conjugate(d, true);
}

static void methods_are_their_formulas(void)
{
    static const struct {
        const char *name;
        void (*run)(struct model *d);
    } method[] = {{"cgls-paper", model_cgls_paper},
                  {"cgls", model_cgls},
                  {"mlem", model_mlem},
                  {"osem", model_osem},
                  {"sirt", model_sirt},
                  {"fista", model_fista},
                  {"mrnsd", model_mrnsd}};
    struct system y;
    struct rec_solve_params p = rec_solve_defaults;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = KEEP;
    for (int nch = 1; nch <= 3; nch += 2) {
        system_new(&y, nch, 0.3);
        pictures(&y, 0.02);
        for (size_t i = 0; i < y.rows; i++)
            y.w[i] = i % 7 == 0 ? 0 : i % 5 == 0 ? 0.25f : 1;
        for (size_t k = 0; k < sizeof method / sizeof *method; k++) {
            struct model d;
            double e = 0, t = 0;
            model_new(&d, &y);
            method[k].run(&d);
            p.solver = method[k].name;
            clear(&y);
            struct rec_solve_report r = solve(&y, &p, NULL, NULL);
            T_EQ_I(r.iterations, KEEP);
            for (size_t q = 0; q < d.n; q++) {
                double x = y.x[q * (size_t)y.cs], diff = x - d.x[q];
                e += diff * diff;
                t += d.x[q] * d.x[q];
            }
            T_OK(t > 0);
            T_CHECK_(e <= 1e-8 * t, "%s, %d channels: off by %.3g", p.solver, nch, sqrt(e / t));
            model_free(&d);
        }
        system_free(&y);
    }
}

/* ---- what all of them promise ---------------------------------------------------------------------*/

struct watch {
    const struct system *y;
    float *ax;
    double last_residual, last_kl;
    int residual_rises, kl_rises, negative;
    const float *truth; /* [n][cs] or NULL: least error so far */
    double least;
};
static void watch(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    struct watch *t = ctx;
    const struct rec_subsys *a = t->y->a;
    size_t cs = (size_t)t->y->cs;
    double kl = 0, e = 0;
    (void)objective;
    rec_forward(a, x, t->ax);
    for (size_t i = 0; i < (size_t)a->rows; i++)
        for (size_t l = 0; l < cs; l++) {
            double b = fmax(t->y->b[a->ray[i] * cs + l], 0), ax = t->ax[i * cs + l];
            if (t->y->w[a->ray[i]] > 0 && b > 0)
                kl += t->y->w[a->ray[i]] * (ax - b + b * log(b / ax));
            else
                kl += t->y->w[a->ray[i]] * ax;
        }
    for (size_t i = 0; i < (size_t)a->n * cs; i++) {
        t->negative += !(x[i] >= 0);
        e += t->truth != NULL ? pow(x[i] - t->truth[i], 2) : 0;
    }
    t->residual_rises += k > 1 && residual > t->last_residual * (1 + 1e-6);
    t->kl_rises += k > 1 && kl > t->last_kl * (1 + 1e-5);
    t->last_residual = residual;
    t->last_kl = kl;
    t->least = k == 1 ? sqrt(e) : fmin(t->least, sqrt(e));
}

static void falls_where_theory_says_so(void)
{
    struct system y;
    system_new(&y, 3, 0.45);
    float *ax = pvx_calloc((size_t)y.a->rows * 4, sizeof *ax);
    for (int t = 0; t < 3; t++) {
        pictures(&y, t == 0 ? 0 : t == 1 ? 0.02 : 0.3);
        for (size_t i = 0; t == 1 && i < y.rows; i++)
            y.w[i] = i % 3 == 0 ? 0 : i % 4 == 0 ? 0.5f : 1;
        for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
            struct rec_solve_params p = {
                .solver = *name, .stop = REC_STOP_ITERATIONS, .iterations = 80};
            struct watch w = {.y = &y, .ax = ax};
            bool squares = strcmp(*name, "sirt") == 0 || strcmp(*name, "mrnsd") == 0;
            clear(&y);
            solve(&y, &p, watch, &w);
            if (strcmp(*name, "cgls") != 0)
                T_EQ_I(w.negative, 0);
            if (squares)
                T_CHECK_(w.residual_rises == 0, "%s: residual rose %d times", *name,
                         w.residual_rises);
            if (strcmp(*name, "mlem") == 0)
                T_EQ_I(w.kl_rises, 0);
            T_OK(sound(&y));
        }
    }
    free(ax);
    system_free(&y);
}

/* b = A x + noise of the scene's truth on the active voxels, which is returned. */
static float *projected_truth(struct system *y, double noise)
{
    size_t n = (size_t)y->a->n * 4;
    float *truth = pvx_calloc(n, sizeof *truth);
    float *ax = pvx_calloc((size_t)y->a->rows * 4, sizeof *ax);
    for (size_t q = 0; q < n; q++)
        truth[q] = q % 4 == 3 ? 0 : sc.truth[(size_t)y->col[q / 4] * 3 + q % 4];
    rec_forward(y->a, truth, ax);
    for (size_t i = 0; i < (size_t)y->a->rows; i++)
        for (size_t l = 0; l < 3; l++)
            y->b[(size_t)y->a->ray[i] * 4 + l] =
                ax[i * 4 + l] + (noise > 0 ? (float)(noise * t_normal()) : 0);
    free(ax);
    return truth;
}

/* b = A x of a non-negative x: the residual can reach 0, and a good start is kept. */
static void exact_data_are_fitted(void)
{
    struct system y;
    system_new(&y, 3, 0.4);
    size_t n = (size_t)y.a->n * 4;
    float *truth = projected_truth(&y, 0);
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        struct rec_solve_params p = {
            .solver = *name, .stop = REC_STOP_ITERATIONS, .iterations = 300};
        /* the paper's clipping is no descent: it stays away from the solution */
        bool paper = strcmp(*name, "cgls-paper") == 0, plain = strcmp(*name, "cgls") == 0;
        clear(&y);
        struct rec_solve_report r = solve(&y, &p, NULL, NULL);
        T_CHECK_(r.rel_residual < (paper   ? 0.5
                                   : plain ? 0.2
                                           : 5e-3),
                 "%s: residual %.3g", *name, r.rel_residual);
        memcpy(y.x, truth, n * sizeof *truth);
        p.iterations = 3;
        r = solve(&y, &p, NULL, NULL);
        if (!paper && !plain) /* they start at 0 always */
            T_CHECK_(r.rel_residual < 0.02, "%s: warm, residual %.3g", *name, r.rel_residual);
        T_OK(sound(&y));
    }
    free(truth);
    system_free(&y);
}

/* The stop at the noise's own size is near the least error of the iteration, though early when a few
 * voxels have many rays, as here; without knowing the noise the bound is lower, without noise it is
 * the only end. */
static void auto_stop_is_near_the_best(void)
{
    struct system y;
    system_new(&y, 3, 0.4);
    size_t n = (size_t)y.a->n * 4;
    float *truth = projected_truth(&y, 0.01);
    float *ax = pvx_calloc((size_t)y.a->rows * 4, sizeof *ax);
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        if (strncmp(*name, "cgls", 4) == 0 || strcmp(*name, "pcg") == 0)
            continue; /* the L-curve; clipped once at the end; its own rule */
        struct rec_solve_params p = {
            .solver = *name, .stop = REC_STOP_ITERATIONS, .iterations = 80};
        struct watch w = {.y = &y, .ax = ax, .truth = truth};
        struct rec_solve_report r;
        double e = 0;
        clear(&y);
        solve(&y, &p, watch, &w);
        p.stop = REC_STOP_AUTO;
        p.iterations = 0;
        clear(&y);
        r = solve(&y, &p, NULL, NULL);
        T_EQ_I(r.status, REC_CONVERGED);
        T_LE(r.residual_norm * r.residual_norm, 1.2e-4 * y.a->rows * 3);
        for (size_t q = 0; q < n; q++)
            e += pow(y.x[q] - truth[q], 2);
        T_CHECK_(sqrt(e) <= 1.5 * w.least, "%s: error %.4g, least %.4g", *name, sqrt(e), w.least);

        struct rec_solve_report blind, silent;
        clear(&y);
        T_OK(rec_solve(y.s, y.a, y.b, y.w, -1, &p, y.x, NULL, NULL, &blind) == PVX_OK);
        clear(&y);
        T_OK(rec_solve(y.s, y.a, y.b, y.w, 0, &p, y.x, NULL, NULL, &silent) == PVX_OK);
        T_EQ_I(blind.status, REC_MAX_ITER);
        T_EQ_I(silent.status, REC_MAX_ITER);
        T_OK(blind.iterations < silent.iterations);
    }
    free(truth);
    free(ax);
    system_free(&y);
}

/* Noise so low that the basis can not follow: the discrepancy is never met, AUTO ends where the
 * residual stands still. */
static void auto_stop_sees_a_stall(void)
{
    static const char *const names[] = {"mlem", "osem", "sirt", "fista", "mrnsd"};
    struct system y;
    system_new(&y, 3, 0.45);
    pictures(&y, 0);
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        struct rec_solve_params p = {
            .solver = names[k], .stop = REC_STOP_ITERATIONS, .iterations = 1000};
        struct rec_solve_report r;
        clear(&y);
        r = solve(&y, &p, NULL, NULL);
        double sigma = 0.8 * r.residual_norm / sqrt(3.0 * y.a->rows);
        p.iterations = 300;
        p.stop = REC_STOP_DISCREPANCY;
        clear(&y);
        T_OK(rec_solve(y.s, y.a, y.b, y.w, sigma, &p, y.x, NULL, NULL, &r) == PVX_OK);
        T_EQ_I(r.status, REC_MAX_ITER);
        T_EQ_I(r.iterations, 300);
        p.stop = REC_STOP_AUTO;
        clear(&y);
        T_OK(rec_solve(y.s, y.a, y.b, y.w, sigma, &p, y.x, NULL, NULL, &r) == PVX_OK);
        T_EQ_I(r.status, REC_CONVERGED);
        T_CHECK_(r.iterations < 100, "%s: %u iterations", names[k], r.iterations);
        T_LE(r.residual_norm, 2 * sigma * sqrt(3.0 * y.a->rows) * (1 + 1e-5));
    }
    system_free(&y);
}

static void rows_left_out_say_nothing(void)
{
    struct system y;
    system_new(&y, 3, 0.4);
    size_t n = (size_t)y.a->n * 4;
    float *first = pvx_calloc(n, sizeof *first);
    struct rec_solve_params p = rec_solve_defaults;
    p.iterations = 10;
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        p.solver = *name;
        for (int t = 0; t < 2; t++) {
            t_state = 5;
            pictures(&y, 0.01);
            for (size_t i = 0; i < y.rows; i++) {
                y.w[i] = i % 3 == 0 || i < y.a->row0[1] ? 0 : 1; /* and a whole camera */
                for (size_t l = 0; t == 1 && y.w[i] == 0 && l < 3; l++)
                    y.b[i * 4 + l] = 1e6f;
            }
            clear(&y);
            solve(&y, &p, NULL, NULL);
            if (t == 0)
                memcpy(first, y.x, n * sizeof *first);
        }
        T_CHECK_(memcmp(first, y.x, n * sizeof *first) == 0, "%s: weight 0 counts", *name);
        T_OK(sound(&y));
    }
    free(first);
    system_free(&y);
}

static void any_number_of_threads(void)
{
    pvx_pool *two = sc.pool;
    struct rec_solve_params p = rec_solve_defaults;
    float *first[16] = {NULL};
    static const unsigned threads[] = {1, 3};
    for (int t = 0; t < 2; t++) {
        struct system y;
        if (pvx_pool_new(threads[t], "test", &sc.pool) != PVX_OK)
            exit(2);
        system_new(&y, 3, 0.45);
        t_state = 7;
        pictures(&y, 0.02);
        size_t n = (size_t)y.a->n * 4;
        for (int k = 0; rec_solver_names()[k] != NULL; k++) {
            p.solver = rec_solver_names()[k];
            clear(&y);
            solve(&y, &p, NULL, NULL);
            if (t == 0) {
                first[k] = pvx_calloc(n, sizeof *first[k]);
                memcpy(first[k], y.x, n * sizeof *y.x);
            } else {
                T_CHECK_(memcmp(first[k], y.x, n * sizeof *y.x) == 0, "%s: other bits", p.solver);
                free(first[k]);
            }
        }
        system_free(&y);
        pvx_pool_free(&sc.pool);
    }
    sc.pool = two;
}

/* The deadline passes after the third iterate: that one is returned. */
struct late {
    struct rec_solve_params *p;
    const struct system *y;
    float *third;
};
static void late(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    struct late *t = ctx;
    (void)objective;
    (void)residual;
    if (k == 3) {
        memcpy(t->third, x, (size_t)t->y->a->n * 4 * sizeof *x);
        t->p->deadline_ns = pvx_now_mono() - 1;
    }
}
static void deadline_gives_what_there_is(void)
{
    struct system y;
    system_new(&y, 3, 0.45);
    pictures(&y, 0.001);
    float *third = pvx_calloc((size_t)y.a->n * 4, sizeof *third);
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        struct rec_solve_params p = {.solver = *name, .stop = REC_STOP_ITERATIONS, .lambda = -1};
        struct late t = {&p, &y, third};
        p.iterations = 1000;
        clear(&y);
        struct rec_solve_report r = solve(&y, &p, late, &t);
        T_EQ_I(r.status, REC_DEADLINE);
        T_EQ_I(r.iterations, 3);
        T_EQ_I(r.best, 3);
        int differ = 0;
        for (size_t q = 0; q < (size_t)y.a->n * 4; q++)
            differ += y.x[q] != (third[q] > 0 ? third[q] : 0);
        T_EQ_I(differ, 0);
    }
    free(third);
    system_free(&y);
}

int main(void)
{
    if (!scene_new(&sc, 5, 40, 12, 2, 2))
        return 2;
    T_RUN(pcg_is_the_dense_solution);
    T_RUN(pcg_never_rises);
    T_RUN(channels_do_not_meet);
    T_RUN(one_channel_is_a_lane_of_three);
    T_RUN(stop_rules);
    T_RUN(report_is_true);
    T_RUN(hard_right_hand_sides);
    T_RUN(degenerate_systems);
    T_RUN(methods_are_their_formulas);
    T_RUN(falls_where_theory_says_so);
    T_RUN(exact_data_are_fitted);
    T_RUN(auto_stop_is_near_the_best);
    T_RUN(auto_stop_sees_a_stall);
    T_RUN(rows_left_out_say_nothing);
    T_RUN(any_number_of_threads);
    T_RUN(deadline_gives_what_there_is);
    scene_free(&sc);
    return t_done();
}
