/* Singular values by bidiagonalisation against those of the dense matrix by one-sided Jacobi. */
#include "../scene.h"

#include "recon/condition.h"

static struct scene sc;
static struct rec_kernels kernels;

struct system {
    struct rec_subsys *a;
    int32_t *col;
    float *w; /* row space */
};

/* Voxels of a ball in the middle, the first `cameras` cameras. */
static void system_new(struct system *y, double radius, size_t cameras)
{
    bool present[REC_MAX_CAMERAS];
    int32_t n = 0;
    y->col = pvx_calloc(sc.voxels, sizeof *y->col);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        present[c] = c < cameras;
    for (int32_t i = 0; i < (int32_t)sc.voxels; i++) {
        double p[3];
        rec_grid_centre(&sc.rig.grid, i, p);
        if (p[0] * p[0] + p[1] * p[1] + (p[2] - 0.5) * (p[2] - 0.5) < radius * radius)
            y->col[n++] = i;
    }
    if (rec_subsys_new(sc.S, &kernels, sc.pool, 1, &y->a) != PVX_OK)
        exit(2);
    rec_subsys_restrict(y->a, y->col, n, present);
    y->w = pvx_calloc(y->a->row0[sc.S->n_cameras], sizeof *y->w);
    for (size_t i = 0; i < y->a->row0[sc.S->n_cameras]; i++)
        y->w[i] = i % 7 == 3 ? 0 : i % 7 == 5 ? 0.25f : 1;
}
static void system_free(struct system *y)
{
    rec_subsys_free(&y->a);
    free(y->col);
    free(y->w);
}

static int descending(const void *a, const void *b)
{
    double u = *(const double *)a, v = *(const double *)b;
    return u < v ? 1 : u > v ? -1 : 0;
}

/* Singular values, descending, of the m vectors of length len in v [m][len] (overwritten), m <= len:
 * rotations make each pair orthogonal; what is left of them are the lengths. */
static void jacobi(double *v, size_t m, size_t len, double *sigma)
{
    bool done = false;
    for (int sweep = 0; sweep < 60 && !done; sweep++) {
        done = true;
        for (size_t p = 0; p + 1 < m; p++)
            for (size_t q = p + 1; q < m; q++) {
                double *x = v + p * len, *y = v + q * len, xx = 0, yy = 0, xy = 0;
                for (size_t i = 0; i < len; i++) {
                    xx += x[i] * x[i];
                    yy += y[i] * y[i];
                    xy += x[i] * y[i];
                }
                if (fabs(xy) <= 1e-15 * sqrt(xx * yy))
                    continue;
                done = false;
                double zeta = (yy - xx) / (2 * xy);
                double t = copysign(1, zeta) / (fabs(zeta) + sqrt(1 + zeta * zeta));
                double c = 1 / sqrt(1 + t * t), s = c * t;
                for (size_t i = 0; i < len; i++) {
                    double a = x[i], b = y[i];
                    x[i] = c * a - s * b;
                    y[i] = s * a + c * b;
                }
            }
    }
    for (size_t p = 0; p < m; p++) {
        sigma[p] = 0;
        for (size_t i = 0; i < len; i++)
            sigma[p] += v[p * len + i] * v[p * len + i];
        sigma[p] = sqrt(sigma[p]);
    }
    qsort(sigma, m, sizeof *sigma, descending);
}

/* The same from the definition: (1) of condition.h written out densely.  Returns how many. */
static size_t dense(const struct system *y, const float *w, double lambda, double **sigma)
{
    const struct rec_subsys *a = y->a;
    size_t n = (size_t)a->n, rows = (size_t)a->rows, all = rows + (lambda > 0 ? n : 0);
    double *k = pvx_calloc(all * n, sizeof *k); /* [row][column] */
    for (size_t i = 0; i < rows; i++)
        for (uint32_t e = a->by_row.ptr[i]; e < a->by_row.ptr[i + 1]; e++)
            k[i * n + rec_packed_index(&a->by_row, e)] =
                rec_packed_value(&a->by_row, e) * sqrt(w == NULL ? 1 : (double)w[a->ray[i]]);
    for (size_t p = 0; lambda > 0 && p < n; p++)
        for (size_t q = 0; q < n; q++) {
            int32_t u[3], v[3];
            rec_grid_ijk(&sc.rig.grid, a->col[p], u);
            rec_grid_ijk(&sc.rig.grid, a->col[q], v);
            int apart = abs(u[0] - v[0]) + abs(u[1] - v[1]) + abs(u[2] - v[2]);
            k[(rows + p) * n + q] = sqrt(lambda) * (apart == 0 ? 6 : apart == 1 ? -1 : 0);
        }
    size_t m = n < all ? n : all;
    double *v = pvx_calloc(all * n, sizeof *v);
    for (size_t i = 0; i < all; i++)
        for (size_t q = 0; q < n; q++)
            v[n < all ? q * all + i : i * n + q] = k[i * n + q];
    *sigma = pvx_calloc(m, sizeof **sigma);
    jacobi(v, m, n < all ? all : n, *sigma);
    free(v);
    free(k);
    return m;
}

static void compare(double radius, size_t cameras, bool weights, double lambda)
{
    struct system y;
    system_new(&y, radius, cameras);
    const float *w = weights ? y.w : NULL;
    double *sigma;
    size_t m = dense(&y, w, lambda, &sigma), above = 0;
    struct rec_condition_params p = {.steps = 1 << 20, .lambda = lambda};
    struct rec_condition c;
    T_EQ_I(rec_condition(y.a, w, &p, &c), PVX_OK);
    for (size_t i = 0; i < m; i++)
        above += sigma[i] > 1e-3 * sigma[0];
    printf("  %d x %d%s lambda %g: sigma %.4g .. %.4g, %zu of %zu above, got %.4g .. %.4g, %.1f\n",
           c.rows, c.columns, weights ? " weighted" : "", lambda, sigma[0], sigma[m - 1], above, m,
           c.sigma_max, c.sigma_min, c.rank);
    T_EQ_I(c.columns, y.a->n);
    T_OK(c.exact);
    T_NEAR(c.sigma_max, sigma[0], 1e-12 * sigma[0]);
    T_NEAR(c.sigma_min, sigma[m - 1], 1e-12 * sigma[0]);
    if (sigma[m - 1] > 1e-10 * sigma[0])
        T_NEAR(c.condition, sigma[0] / sigma[m - 1], 1e-3 * c.condition);
    /* the count: a mean over starts */
    p.probes = 20;
    T_EQ_I(rec_condition(y.a, w, &p, &c), PVX_OK);
    T_NEAR(c.rank, above, 0.5 + sqrt((double)m / p.probes));
    /* few steps: a lower and an upper estimate */
    p = (struct rec_condition_params){.steps = 12, .lambda = lambda};
    T_EQ_I(rec_condition(y.a, w, &p, &c), PVX_OK);
    T_EQ_I(c.steps, m < 12 ? m : 12);
    T_LE(c.sigma_max, sigma[0] * (1 + 1e-12));
    T_NEAR(c.sigma_max, sigma[0], 1e-3 * sigma[0]);
    T_OK(c.sigma_min >= sigma[m - 1] - 1e-12 * sigma[0]);
    free(sigma);
    system_free(&y);
}

static void more_rows_than_columns(void)
{
    compare(0.22, 5, false, 0);
}
static void more_columns_than_rows(void)
{
    compare(0.3, 1, false, 0);
}
static void weighted_rows(void)
{
    compare(0.2, 4, true, 0);
}
static void with_the_smoothness_term(void)
{
    compare(0.22, 2, true, 1e-4);
    compare(0.22, 5, false, 1e-2);
}

/* The bound on the smallest singular value falls with every step, that on the largest rises. */
static void estimates_are_monotone(void)
{
    struct system y;
    system_new(&y, 0.35, 5);
    double max = 0, min = INFINITY;
    for (int32_t steps = 2; steps <= 96; steps *= 2) {
        struct rec_condition_params p = {.steps = steps};
        struct rec_condition c;
        T_EQ_I(rec_condition(y.a, NULL, &p, &c), PVX_OK);
        T_EQ_I(c.steps, steps);
        T_LE(max, c.sigma_max * (1 + 1e-13));
        T_LE(c.sigma_min, min * (1 + 1e-9));
        T_OK(!c.exact);
        max = c.sigma_max;
        min = c.sigma_min;
    }
    system_free(&y);
}

static void degenerate_systems(void)
{
    struct system y;
    struct rec_condition_params p = {0};
    struct rec_condition c;
    system_new(&y, 0.1, 5);
    int32_t n = y.a->n;
    bool present[REC_MAX_CAMERAS] = {true, true};
    rec_subsys_restrict(y.a, y.col, 0, present); /* no column */
    T_EQ_I(rec_condition(y.a, NULL, &p, &c), PVX_OK);
    T_OK(c.sigma_max == 0 && c.rank == 0 && c.columns == 0);
    rec_subsys_restrict(y.a, y.col, 1, present); /* one: its norm */
    float norm2;
    rec_column_norms(y.a, NULL, &norm2, NULL);
    T_EQ_I(rec_condition(y.a, NULL, &p, &c), PVX_OK);
    T_OK(c.exact);
    T_NEAR(c.sigma_max, sqrt((double)norm2), 1e-6 * c.sigma_max);
    T_NEAR(c.condition, 1, 1e-12);
    T_NEAR(c.rank, 1, 1e-12);
    rec_subsys_restrict(y.a, y.col, n, present); /* every row left out */
    memset(y.w, 0, y.a->row0[sc.S->n_cameras] * sizeof *y.w);
    T_EQ_I(rec_condition(y.a, y.w, &p, &c), PVX_OK);
    T_OK(c.sigma_max == 0 && c.rank == 0 && isinf(c.condition));
    static const struct rec_condition_params bad[] = {
        {.steps = -1}, {.probes = -1}, {.lambda = -1}, {.lambda = NAN}, {.limit = 1}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        T_EQ_I(rec_condition(y.a, NULL, &bad[i], &c), PVX_EINVAL);
    system_free(&y);
}

int main(void)
{
    rec_kernels_init(&kernels, REC_CPU_ALL);
    if (!scene_new(&sc, 5, 40, 14, 2, 2))
        return 2;
    T_RUN(more_rows_than_columns);
    T_RUN(more_columns_than_rows);
    T_RUN(weighted_rows);
    T_RUN(with_the_smoothness_term);
    T_RUN(estimates_are_monotone);
    T_RUN(degenerate_systems);
    scene_free(&sc);
    return t_done();
}
