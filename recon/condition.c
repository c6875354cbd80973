#include "recon/condition.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define STEPS 150
#define LIMIT 1e-3

struct op {
    const struct rec_subsys *a;
    double *w; /* [a->rows] square roots of the weights */
    int32_t (
        *near)[6];   /* [n] active index of the neighbours x- x+ y- y+ z- z+, or -1; lambda > 0 */
    double scale[3]; /* sqrt(lambda) (h_min / h_axis)^2 */
    size_t rows, n;  /* of K */
};

/* ---- products ------------------------------------------------------------------------------------*/

/* out += sqrt(lambda) L x, which is symmetric. */
static void add_smooth(const struct op *k, const double *x, double *out)
{
    for (size_t q = 0; k->near != NULL && q < k->n; q++)
        for (int f = 0; f < 6; f++) {
            int32_t to = k->near[q][f];
            out[q] += k->scale[f / 2] * (x[q] - (to < 0 ? 0 : x[to]));
        }
}

static void forward(const struct op *k, const double *x, double *y)
{
    const struct rec_packed *g = &k->a->by_row;
    size_t rows = (size_t)k->a->rows;
    for (size_t i = 0; i < rows; i++) {
        double s = 0;
        for (uint32_t e = g->ptr[i]; e < g->ptr[i + 1]; e++)
            s += (double)rec_packed_value(g, e) * x[rec_packed_index(g, e)];
        y[i] = k->w[i] * s;
    }
    memset(y + rows, 0, (k->rows - rows) * sizeof *y);
    add_smooth(k, x, y + rows);
}

static void adjoint(const struct op *k, const double *y, double *x)
{
    const struct rec_packed *g = &k->a->by_col;
    for (size_t q = 0; q < k->n; q++) {
        double s = 0;
        for (uint32_t e = g->ptr[q]; e < g->ptr[q + 1]; e++)
            s += (double)rec_packed_value(g, e) * k->w[rec_packed_index(g, e)] *
                 y[rec_packed_index(g, e)];
        x[q] = s;
    }
    add_smooth(k, y + k->a->rows, x);
}

/* Active index of voxel v, or -1; col ascends. */
static int32_t find(const int32_t *col, int32_t n, int32_t v)
{
    int32_t at = rec_first_column(col, n, v);
    return at < n && col[at] == v ? at : -1;
}

static void find_neighbours(struct op *k, double lambda)
{
    const struct rec_grid *g = &k->a->S->grid;
    const int32_t stride[3] = {1, g->n[0], g->n[0] * g->n[1]};
    double h = fmin(rec_grid_h(g, 0), fmin(rec_grid_h(g, 1), rec_grid_h(g, 2)));
    for (int axis = 0; axis < 3; axis++)
        k->scale[axis] = sqrt(lambda) * h * h / (rec_grid_h(g, axis) * rec_grid_h(g, axis));
    for (size_t q = 0; q < k->n; q++) {
        int32_t ijk[3];
        rec_grid_ijk(g, k->a->col[q], ijk);
        for (int f = 0; f < 6; f++) {
            int axis = f / 2, way = f & 1 ? 1 : -1, at = ijk[axis] + way;
            k->near[q][f] = at < 0 || at >= g->n[axis]
                                ? -1
                                : find(k->a->col, k->a->n, k->a->col[q] + way * stride[axis]);
        }
    }
}

/* ---- vectors -------------------------------------------------------------------------------------*/

/* Four sums side by side: one alone waits for each addition. */
static double dot(const double *u, const double *v, size_t n)
{
    double s[4] = {0};
    size_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (size_t l = 0; l < 4; l++)
            s[l] += u[i + l] * v[i + l];
    for (; i < n; i++)
        s[0] += u[i] * v[i];
    return (s[0] + s[1]) + (s[2] + s[3]);
}

/* v made orthogonal to the first `count` rows of basis [count][n]; its norm.  Twice is enough. */
static double orthogonalise(const double *basis, int32_t count, double *v, size_t n)
{
    for (int pass = 0; pass < 2; pass++)
        for (int32_t i = 0; i < count; i++) {
            const double *b = basis + (size_t)i * n;
            double s = dot(b, v, n);
            for (size_t q = 0; q < n; q++)
                v[q] -= s * b[q];
        }
    return sqrt(dot(v, v, n));
}

static void divide(double *v, double by, size_t n)
{
    for (size_t i = 0; i < n; i++)
        v[i] /= by;
}

/* Random signs: as good a start as normal numbers, and of known length. */
static void start_vector(double *v, size_t n, uint64_t *state)
{
    for (size_t i = 0; i < n; i++) {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        v[i] = (*state >> 40 & 1 ? 1 : -1) / sqrt((double)n);
    }
}

/* ---- spectrum ------------------------------------------------------------------------------------*/

/* Eigenvalues of the symmetric tridiagonal matrix with diagonal d [n] and off-diagonal e [n-1] (room
 * for n), into d; z [n]: first components of the unit eigenvectors.  Implicit QL with Wilkinson's
 * shift, absolute accuracy of a few roundings of the norm. */
static void tridiagonal(int32_t n, double *d, double *e, double *z)
{
    double norm = 0;
    for (int32_t i = 0; i < n; i++) {
        z[i] = i == 0;
        norm = fmax(norm, fabs(d[i]) + (i + 1 < n ? fabs(e[i]) : 0));
    }
    e[n - 1] = 0;
    for (int32_t l = 0; l < n; l++)
        for (int round = 0; round < 100; round++) {
            int32_t m = l;
            while (m + 1 < n && fabs(e[m]) > DBL_EPSILON * norm)
                m++;
            if (m == l)
                break;
            double g = (d[l + 1] - d[l]) / (2 * e[l]), r = hypot(g, 1), s = 1, c = 1, p = 0;
            g = d[m] - d[l] + e[l] / (g + copysign(r, g));
            int32_t i = m - 1;
            for (; i >= l; i--) {
                double f = s * e[i], b = c * e[i];
                r = hypot(f, g);
                e[i + 1] = r;
                if (r == 0) {
                    d[i + 1] -= p;
                    e[m] = 0;
                    break;
                }
                s = f / r;
                c = g / r;
                g = d[i + 1] - p;
                r = (d[i] - g) * s + 2 * c * b;
                p = s * r;
                d[i + 1] = g + p;
                g = c * r - b;
                f = z[i + 1];
                z[i + 1] = s * z[i] + c * f;
                z[i] = c * z[i] - s * f;
            }
            if (i >= l)
                continue;
            d[l] -= p;
            e[l] = g;
            e[m] = 0;
        }
}

struct work {
    double *near, *far; /* bases on the shorter and the longer side, vector by vector */
    double *d, *e, *z;  /* [2 steps] */
    int32_t steps;
    bool wide; /* more columns than rows: the roles of K and K' change */
    size_t n_near, n_far;
};

static void to_far(const struct op *k, const struct work *t, const double *v, double *u)
{
    t->wide ? adjoint(k, v, u) : forward(k, v, u);
}
static void to_near(const struct op *k, const struct work *t, const double *u, double *v)
{
    t->wide ? forward(k, u, v) : adjoint(k, u, v);
}

/* One start: alpha_1, beta_1, alpha_2 ... in t->e.  Returns the order of the tridiagonal matrix; it
 * is odd when K leads from the last vector nowhere new. */
static int32_t bidiagonalise(const struct op *k, struct work *t, uint64_t *state, bool *exact)
{
    double big = 0;
    start_vector(t->near, t->n_near, state);
    for (int32_t i = 0; i < t->steps; i++) {
        double *v = t->near + (size_t)i * t->n_near, *u = t->far + (size_t)i * t->n_far;
        to_far(k, t, v, u);
        double alpha = orthogonalise(t->far, i, u, t->n_far);
        big = fmax(big, alpha);
        if (alpha <= 1e-14 * big) {
            *exact = true;
            return 2 * i + 1;
        }
        t->e[2 * i] = alpha;
        divide(u, alpha, t->n_far);
        if (i + 1 == t->steps)
            break;
        to_near(k, t, u, v + t->n_near);
        double beta = orthogonalise(t->near, i + 1, v + t->n_near, t->n_near);
        big = fmax(big, beta);
        if (beta <= 1e-14 * big) {
            *exact = true;
            return 2 * i + 2;
        }
        t->e[2 * i + 1] = beta;
        divide(v + t->n_near, beta, t->n_near);
    }
    *exact = *exact || (size_t)t->steps == t->n_near;
    return 2 * t->steps;
}

static void measure(const struct op *k, struct work *t, const struct rec_condition_params *p,
                    struct rec_condition *out)
{
    int32_t probes = p->probes > 0 ? p->probes : 1;
    double limit = p->limit > 0 ? p->limit : LIMIT;
    uint64_t state = 88172645463325252u;
    out->sigma_min = INFINITY;
    for (int32_t probe = 0; probe < probes; probe++) {
        int32_t order = bidiagonalise(k, t, &state, &out->exact);
        memset(t->d, 0, (size_t)order * sizeof *t->d);
        tridiagonal(order, t->d, t->e, t->z);
        double max = 0, min = INFINITY, above = 0;
        for (int32_t i = 0; i < order; i++)
            max = fmax(max, t->d[i]);
        for (int32_t i = 0; i < order; i++) {
            min = fmin(min, fabs(t->d[i])); /* values come in pairs +-sigma, and 0 when odd */
            if (fabs(t->d[i]) > limit * max)
                above += t->z[i] * t->z[i];
        }
        out->steps = order / 2 > out->steps ? order / 2 : out->steps;
        out->sigma_max = fmax(out->sigma_max, max);
        out->sigma_min = fmin(out->sigma_min, min);
        out->rank += above * (double)t->n_near / probes;
    }
    double zero = 8 * DBL_EPSILON * out->sigma_max;
    out->condition = out->sigma_min > zero ? out->sigma_max / out->sigma_min : INFINITY;
}

pvx_err rec_condition(const struct rec_subsys *a, const float *weight,
                      const struct rec_condition_params *p, struct rec_condition *out)
{
    *out = (struct rec_condition){.rows = a->rows, .columns = a->n};
    if (p->steps < 0 || p->probes < 0 || !(p->lambda >= 0 && p->lambda < INFINITY) ||
        !(p->limit >= 0 && p->limit < 1))
        return PVX_EINVAL;
    if (a->n == 0 || a->rows == 0)
        return PVX_OK;
    struct op k = {.a = a, .rows = (size_t)a->rows, .n = (size_t)a->n};
    struct work t = {0};
    pvx_err e = PVX_ENOMEM;
    k.w = pvx_calloc((size_t)a->rows, sizeof *k.w);
    if (p->lambda > 0) {
        k.rows += k.n;
        k.near = pvx_calloc(k.n, sizeof *k.near);
    }
    t.wide = k.n > k.rows;
    t.n_near = t.wide ? k.rows : k.n;
    t.n_far = t.wide ? k.n : k.rows;
    t.steps = p->steps > 0 ? p->steps : STEPS;
    if ((size_t)t.steps > t.n_near)
        t.steps = (int32_t)t.n_near;
    t.near = pvx_calloc((size_t)t.steps * t.n_near, sizeof *t.near);
    t.far = pvx_calloc((size_t)t.steps * t.n_far, sizeof *t.far);
    t.d = pvx_calloc((size_t)t.steps * 2, sizeof *t.d);
    t.e = pvx_calloc((size_t)t.steps * 2, sizeof *t.e);
    t.z = pvx_calloc((size_t)t.steps * 2, sizeof *t.z);
    if (k.w != NULL && (k.near != NULL || !(p->lambda > 0)) && t.near != NULL && t.far != NULL &&
        t.d != NULL && t.e != NULL && t.z != NULL) {
        out->rows = (int32_t)k.rows;
        for (int32_t i = 0; i < a->rows; i++)
            k.w[i] = weight == NULL ? 1 : sqrt((double)weight[a->ray[i]]);
        if (k.near != NULL)
            find_neighbours(&k, p->lambda);
        measure(&k, &t, p, out);
        e = PVX_OK;
    }
    free(k.w);
    free(k.near);
    free(t.near);
    free(t.far);
    free(t.d);
    free(t.e);
    free(t.z);
    return e;
}
