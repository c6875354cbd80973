#include "recon/traverse.h"

#include <stdbool.h>
#include "tests/t.h"

static const struct rec_grid unit = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {8, 8, 8}, REC_BOX};

struct hits {
    size_t n;
    int32_t *index;
    float *value;
    double sum;
};

/* Walk with exactly rec_traverse_max() places (ASan guards the ends) and check what must always hold. */
static struct hits walk(const struct rec_grid *g, const double o[3], const double d[3])
{
    struct hits h = {0};
    size_t max = rec_traverse_max(g);
    h.index = malloc(max * sizeof *h.index);
    h.value = malloc(max * sizeof *h.value);
    uint8_t *seen = calloc(rec_grid_count(g), 1);
    if (h.index == NULL || h.value == NULL || seen == NULL)
        abort();
    h.n = rec_traverse(g, o, d, h.index, h.value);
    T_LE(h.n, max);
    for (size_t i = 0; i < h.n; i++) {
        T_OK(h.index[i] >= 0 && (size_t)h.index[i] < rec_grid_count(g));
        T_OK(!seen[h.index[i]]);
        seen[h.index[i]] = 1;
        T_OK(isfinite(h.value[i]) && h.value[i] > 0);
        h.sum += h.value[i];
    }
    free(seen);
    return h;
}

static void drop(struct hits *h)
{
    free(h->index);
    free(h->value);
}

static double value_at(const struct hits *h, int32_t index)
{
    for (size_t i = 0; i < h->n; i++)
        if (h->index[i] == index)
            return h->value[i];
    return 0;
}

/* Length of the half line inside [lo,hi], by slabs in long double. */
static double slab(const double lo[3], const double hi[3], const double o[3], const double d[3])
{
    long double s0 = 0, s1 = 1e30L, n2 = 0;
    for (int a = 0; a < 3; a++) {
        n2 += (long double)d[a] * d[a];
        if (d[a] == 0) {
            if (o[a] < lo[a] || o[a] > hi[a])
                return 0;
            continue;
        }
        long double p = ((long double)lo[a] - o[a]) / d[a], q = ((long double)hi[a] - o[a]) / d[a];
        s0 = fmaxl(s0, fminl(p, q));
        s1 = fminl(s1, fmaxl(p, q));
    }
    return s1 > s0 ? (double)((s1 - s0) * sqrtl(n2)) : 0;
}

static void random_ray(const struct rec_grid *g, double o[3], double d[3])
{
    for (int a = 0; a < 3; a++) {
        double size = g->max[a] - g->min[a];
        o[a] = g->min[a] + size * t_uniform(-1.5, 2.5);
        d[a] = g->min[a] + size * t_uniform(0, 1) - o[a]; /* through the box */
    }
    int kind = (int)(t_rand() % 8); /* sometimes parallel to a face or an edge */
    if (kind < 3) {
        o[kind] += d[kind]; /* the aim's coordinate: stays in the box */
        d[kind] = 0;
        if (kind == 0) {
            o[1] += d[1];
            d[1] = 0;
        }
    }
}

static struct rec_grid random_grid(enum rec_basis b)
{
    struct rec_grid g = {.basis = b};
    for (int a = 0; a < 3; a++) {
        g.min[a] = t_uniform(-2, 2);
        g.max[a] = g.min[a] + t_uniform(0.1, 2);
        g.n[a] = 1 + (int32_t)(t_rand() % 9);
    }
    return g;
}

static void box_against_every_voxel(void)
{
    for (int r = 0; r < 3000; r++) {
        struct rec_grid g = random_grid(REC_BOX);
        double o[3], d[3], worst = 0;
        random_ray(&g, o, d);
        struct hits h = walk(&g, o, d);
        for (int32_t i = 0; i < (int32_t)rec_grid_count(&g); i++) {
            int32_t c[3];
            double lo[3], hi[3];
            rec_grid_ijk(&g, i, c);
            for (int a = 0; a < 3; a++) {
                lo[a] = g.min[a] + c[a] * rec_grid_h(&g, a);
                hi[a] = g.min[a] + (c[a] + 1) * rec_grid_h(&g, a);
            }
            worst = fmax(worst, fabs(value_at(&h, i) - slab(lo, hi, o, d)));
        }
        double chord = slab(g.min, g.max, o, d);
        T_LE(worst, 1e-7 * (chord + 1e-5));
        T_NEAR(h.sum, chord, 1e-6 * chord + 1e-14);
        drop(&h);
    }
}

/* phi_i along the ray */
static double phi(const struct rec_grid *g, int32_t i, const double o[3], const double d[3],
                  double s)
{
    double c[3], v = 1;
    rec_grid_centre(g, i, c);
    for (int a = 0; a < 3; a++)
        v *= fmax(0, 1 - fabs(o[a] + s * d[a] - c[a]) / rec_grid_h(g, a));
    return v;
}

static double length(const double d[3])
{
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

/* Part of the ray in the box grown by `grow` spacings. */
static bool clip(const struct rec_grid *g, double grow, const double o[3], const double d[3],
                 double *s0, double *s1)
{
    *s0 = 0;
    *s1 = 1e30;
    for (int a = 0; a < 3; a++) {
        double h = rec_grid_h(g, a), lo = g->min[a] - grow * h, hi = g->max[a] + grow * h;
        if (d[a] == 0) {
            if (o[a] < lo || o[a] > hi)
                return false;
            continue;
        }
        double p = (lo - o[a]) / d[a], q = (hi - o[a]) / d[a];
        *s0 = fmax(*s0, fmin(p, q));
        *s1 = fmin(*s1, fmax(p, q));
    }
    return *s0 < *s1;
}

static void trilinear_against_quadrature(void)
{
    enum { STEPS = 100000 };
    for (int r = 0; r < 12; r++) {
        struct rec_grid g = random_grid(REC_TRILINEAR);
        double o[3], d[3], s0, s1;
        random_ray(&g, o, d);
        if (!clip(&g, 0.5, o, d, &s0, &s1))
            continue;
        struct hits h = walk(&g, o, d);
        size_t N = rec_grid_count(&g), found = 0;
        for (int32_t i = 0; i < (int32_t)N; i++) {
            double got = value_at(&h, i), sum = 0;
            found += got > 0;
            if (got == 0 && t_rand() % 8 != 0)
                continue; /* a sample of those that should be empty */
            for (int q = 0; q < STEPS; q++)
                sum += phi(&g, i, o, d, s0 + (s1 - s0) * (q + 0.5) / STEPS);
            sum *= (s1 - s0) / STEPS * length(d);
            T_NEAR(got, sum, 1e-6 * sum + 1e-9 * length(d) * (s1 - s0));
        }
        T_EQ_I(found, h.n);
        drop(&h);
    }
}

/* Integral of the polynomial (22) with the coefficients (23), both with their errata, over one cell of
 * unit size; v in the order zyx. */
static double paper_cell(const double v[8], const double p[3], const double r[3], double s1,
                         double s2)
{
    double p000 = v[0], p001 = v[1], p010 = v[2], p011 = v[3];
    double p100 = v[4], p101 = v[5], p110 = v[6], p111 = v[7];
    double a1 = -p000 + p001 + p010 - p011 + p100 - p101 - p110 + p111;
    double a2 = p000 - p001 - p010 + p011, a3 = p000 - p001 - p100 + p101;
    double a4 = p000 - p010 - p100 + p110, a5 = p001 - p000, a6 = p010 - p000;
    double a7 = p100 - p000, a8 = p000;
    double px = p[0], py = p[1], pz = p[2], rx = r[0], ry = r[1], rz = r[2];
    double c3 = a1 * rx * ry * rz;
    double c2 = a1 * (rx * ry * pz + px * ry * rz + py * rx * rz) + a2 * rx * ry + a3 * rx * rz +
                a4 * ry * rz;
    double c1 = a1 * (pz * px * ry + pz * py * rx + px * py * rz) + a2 * (px * ry + py * rx) +
                a3 * (px * rz + pz * rx) + a4 * (py * rz + pz * ry) + a5 * rx + a6 * ry + a7 * rz;
    double c0 = a1 * px * py * pz + a2 * px * py + a3 * px * pz + a4 * py * pz + a5 * px + a6 * py +
                a7 * pz + a8;
#define F(s) ((s) * (c0 + (s) * (c1 / 2 + (s) * (c2 / 3 + (s)*c3 / 4))))
    return F(s2) - F(s1);
#undef F
}

/* The line integral of a random field through S, and through the paper's formula cell by cell. */
static void trilinear_against_the_paper(void)
{
    for (int r = 0; r < 500; r++) {
        struct rec_grid g = random_grid(REC_TRILINEAR);
        double coeff[1000], o[3], d[3], want = 0, got = 0, size = 0;
        for (size_t i = 0; i < rec_grid_count(&g); i++)
            coeff[i] = t_uniform(-1, 1);
        random_ray(&g, o, d);
        struct hits h = walk(&g, o, d);
        for (size_t i = 0; i < h.n; i++)
            got += h.value[i] * coeff[h.index[i]];
        for (int32_t k = -1; k < g.n[2]; k++)
            for (int32_t j = -1; j < g.n[1]; j++)
                for (int32_t i = -1; i < g.n[0]; i++) {
                    struct rec_grid cell = {.n = {1, 1, 1}};
                    int32_t at[3] = {i, j, k};
                    double v[8], p[3], dir[3], s0, s1, f;
                    for (int a = 0; a < 3; a++) {
                        double step = rec_grid_h(&g, a);
                        cell.min[a] = g.min[a] + (at[a] + 0.5) * step;
                        cell.max[a] = cell.min[a] + step;
                        p[a] = (o[a] - cell.min[a]) / step;
                        dir[a] = d[a] / step;
                    }
                    if (!clip(&cell, 0, o, d, &s0, &s1))
                        continue;
                    for (int c = 0; c < 8; c++) {
                        int32_t x = i + (c & 1), y = j + (c >> 1 & 1), z = k + (c >> 2);
                        bool in =
                            x >= 0 && y >= 0 && z >= 0 && x < g.n[0] && y < g.n[1] && z < g.n[2];
                        v[c] = in ? coeff[rec_grid_index(&g, x, y, z)] : 0;
                    }
                    /* start in the cell: (22)'s coefficients grow with the cube of p */
                    for (int a = 0; a < 3; a++)
                        p[a] += s0 * dir[a];
                    f = length(d) * paper_cell(v, p, dir, 0, s1 - s0);
                    want += f;
                    size += length(d) * (s1 - s0);
                }
        T_NEAR(got, want, 1e-6 * size + 1e-12);
        drop(&h);
    }
}

/* Sum of all basis functions: 1 between the outer centres, falling to 0 half a cell outside. */
static void trilinear_row_sums(void)
{
    enum { STEPS = 20000 };
    for (int r = 0; r < 200; r++) {
        struct rec_grid g = random_grid(REC_TRILINEAR);
        double o[3], d[3], s0, s1, want = 0;
        random_ray(&g, o, d);
        struct hits h = walk(&g, o, d);
        if (clip(&g, 0.5, o, d, &s0, &s1)) {
            for (int q = 0; q < STEPS; q++) {
                double v = 1;
                for (int a = 0; a < 3; a++) {
                    double u = (o[a] + (s0 + (s1 - s0) * (q + 0.5) / STEPS) * d[a] - g.min[a]) /
                                   rec_grid_h(&g, a) +
                               0.5;
                    v *= fmax(0, fmin(1, fmin(u, g.n[a] + 1 - u)));
                }
                want += v;
            }
            want *= (s1 - s0) / STEPS * length(d);
        }
        T_NEAR(h.sum, want, 2e-6 * want + 1e-9);
        drop(&h);
    }
}

static void expect(const struct rec_grid *g, const double o[3], const double d[3], size_t n,
                   double sum)
{
    struct hits h = walk(g, o, d);
    if (n != (size_t)-1)
        T_EQ_I(h.n, n);
    T_NEAR(h.sum, sum, 1e-6 * sum);
    drop(&h);
}

static void misses(void)
{
    static const double rays[][6] = {
        {2, 0, 0.5, 1, 0, 0},          /* away */
        {2, 0, 0.5, 0, 1, 0},          /* past */
        {2, 0.5000001, 0.5, -1, 0, 0}, /* just outside a face */
        {2, 0, 0.5, 0, 0, 0},          /* no direction */
        {2, 2, 0.5, -1, -0.2, 0},      {NAN, 0, 0.5, -1, 0, 0},
        {2, 0, 0.5, -1, NAN, 0},       {2, 0, 0.5, -INFINITY, 0, 0},
        {INFINITY, 0, 0.5, -1, 0, 0},  {0.5, 0, 0.5, 1, 0, 0}, /* starts on the face, going out */
    };
    for (size_t i = 0; i < sizeof rays / sizeof rays[0]; i++)
        expect(&unit, rays[i], rays[i] + 3, 0, 0);
}

/* A ray in a face or along an edge counts once, in the voxel on the upper side. */
static void in_faces_and_edges(void)
{
    double d[3] = {-3, 0, 0};
    for (int j = 0; j <= 8; j++)
        for (int k = 0; k <= 8; k++) {
            double o[3] = {2, -0.5 + j / 8.0, k / 8.0};
            struct hits h = walk(&unit, o, d);
            T_EQ_I(h.n, 8);
            T_NEAR(h.sum, 1, 1e-6);
            int32_t jj = j == 8 ? 7 : j, kk = k == 8 ? 7 : k;
            for (int32_t i = 0; i < 8; i++)
                T_NEAR(value_at(&h, rec_grid_index(&unit, i, jj, kk)), 0.125, 1e-7);
            drop(&h);
        }
    /* faces whose coordinates are not exact: min + i h as everybody computes it */
    struct rec_grid g = {{0, 0, 0}, {0.7, 1.1, 1.3}, {49, 7, 10}, REC_BOX};
    for (int i = 0; i <= 49; i++) {
        double o[3] = {i == 49 ? g.max[0] : g.min[0] + i * rec_grid_h(&g, 0), 0.5, -1};
        double up[3] = {0, 0, 1};
        struct hits h = walk(&g, o, up);
        T_EQ_I(h.n, 10);
        T_EQ_I(h.index[0] % 49, i == 49 ? 48 : i);
        T_NEAR(h.sum, 1.3, 1e-6);
        drop(&h);
    }
}

static void through_corners(void)
{
    static const double sign[4][3] = {{1, 1, 1}, {-1, 1, 1}, {1, -1, -1}, {-1, -1, -1}};
    for (int i = 0; i < 4; i++) { /* diagonals: 8 voxels corner to corner, no slivers */
        double o[3], c[3] = {0, 0, 0.5};
        for (int a = 0; a < 3; a++)
            o[a] = c[a] - 2 * sign[i][a];
        struct hits h = walk(&unit, o, sign[i]);
        T_EQ_I(h.n, 8);
        T_NEAR(h.sum, sqrt(3), 1e-6);
        drop(&h);
        /* in a face's plane, through its corners */
        double o2[3] = {c[0] - 2 * sign[i][0], c[1] - 2 * sign[i][1], 0.5};
        double d2[3] = {sign[i][0], sign[i][1], 0};
        expect(&unit, o2, d2, 8, sqrt(2));
        /* touching the grid in one edge or one corner only: nothing, or nothing of length */
        double edge[3] = {0.5 + sign[i][0], 0.5 - sign[i][0], 0.3};
        double along[3] = {-sign[i][0], sign[i][0], 0};
        expect(&unit, edge, along, (size_t)-1, 0);
    }
}

static void camera_inside(void)
{
    double o[3] = {0.01, 0.02, 0.53}, d[3] = {0, 0, 5};
    expect(&unit, o, d, 4, 0.47);
    double back[3] = {0, 0, -1e-5};
    expect(&unit, o, back, 5, 0.53);
    for (int i = 0; i < 500; i++) {
        double p[3] = {t_uniform(-.5, .5), t_uniform(-.5, .5), t_uniform(0, 1)};
        double dir[3] = {t_normal(), t_normal(), t_normal()};
        expect(&unit, p, dir, (size_t)-1, slab(unit.min, unit.max, p, dir));
    }
    double face[3] = {-0.5, 0, 0.5}, in[3] = {1, 0, 0}; /* starts on a face, going in */
    expect(&unit, face, in, 8, 1);
}

static void tiny_and_huge(void)
{
    static const double scales[] = {1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e12};
    for (size_t i = 0; i < 6; i++)
        for (int r = 0; r < 300; r++) {
            double f = scales[i];
            struct rec_grid g = random_grid(REC_BOX);
            double o[3], d[3];
            random_ray(&g, o, d);
            for (int a = 0; a < 3; a++) {
                g.min[a] *= f;
                g.max[a] *= f;
                o[a] *= f;
                d[a] *= r % 3 == 0 ? 1e-200 : r % 3 == 1 ? 1e200 : 1;
            }
            struct hits h = walk(&g, o, d);
            double unit_d[3], n = 0;
            for (int a = 0; a < 3; a++)
                n = fmax(n, fabs(d[a]));
            for (int a = 0; a < 3; a++)
                unit_d[a] = d[a] / n;
            T_NEAR(h.sum, slab(g.min, g.max, o, unit_d), 1e-6 * h.sum + 1e-12 * f);
            drop(&h);
        }
    /* a grid far from zero, where planes round: defined, whole, no crash */
    for (int r = 0; r < 300; r++) {
        struct rec_grid g = {{1e6, -1e6, 1e6},
                             {1e6 + 1e-9, -1e6 + 1e-9, 1e6 + 1e-9},
                             {64, 64, 64},
                             r % 2 ? REC_BOX : REC_TRILINEAR};
        double o[3] = {1e6 - 1, -1e6 + 1, 1e6 + 0.5}, d[3];
        for (int a = 0; a < 3; a++)
            d[a] = g.min[a] + 5e-10 - o[a];
        struct hits h = walk(&g, o, d);
        T_LE(h.sum, 1e-8);
        drop(&h);
    }
    /* nearly parallel to two axes, down to directions that underflow */
    for (int e = -320; e < 0; e += 5) {
        double tiny = pow(10, e), o[3] = {-2, 0, 0.5}, d[3] = {1, tiny, -tiny};
        expect(&unit, o, d, (size_t)-1, slab(unit.min, unit.max, o, d));
        double o2[3] = {-2, -0.5, 1}; /* and in a face */
        expect(&unit, o2, d, (size_t)-1, slab(unit.min, unit.max, o2, d));
    }
}

/* Everything above holds for the other basis where it makes sense: once per index, inside, finite. */
static void trilinear_adversaries(void)
{
    struct rec_grid g = unit;
    g.basis = REC_TRILINEAR;
    for (int axis = 0; axis < 3; axis++)
        for (int i = -1; i <= 17; i++)
            for (int j = -1; j <= 17; j++) { /* along lines through corners, edges, centres */
                double o[3], d[3] = {0, 0, 0}, want = 1;
                int b = (axis + 1) % 3, c = (axis + 2) % 3;
                o[axis] = 3;
                o[b] = g.min[b] + i / 16.0;
                o[c] = g.min[c] + j / 16.0;
                d[axis] = -1;
                want *= fmax(0, fmin(1, fmin(i / 2.0 + 0.5, 8.5 - i / 2.0)));
                want *= fmax(0, fmin(1, fmin(j / 2.0 + 0.5, 8.5 - j / 2.0)));
                expect(&g, o, d, (size_t)-1, want);
            }
    double o[3] = {-2, -2, -1.5}, d[3] = {1, 1, 1};
    struct hits h = walk(&g, o, d);
    /* diagonal through all centres: (1-u)^3 and u^3 along an edge of the diagonal lattice */
    T_NEAR(value_at(&h, rec_grid_index(&g, 3, 3, 3)), 2 * sqrt(3) / 8 / 4, 1e-7);
    T_NEAR(value_at(&h, rec_grid_index(&g, 4, 3, 3)), sqrt(3) / 8 / 12, 1e-7);
    drop(&h);
    for (int i = 0; i < 500; i++) { /* camera inside */
        double p[3] = {t_uniform(-.6, .6), t_uniform(-.6, .6), t_uniform(-.1, 1.1)};
        double dir[3] = {t_normal(), t_normal(), i % 2 ? 0 : t_normal()};
        double lo[3], hi[3]; /* all of the support */
        for (int a = 0; a < 3; a++) {
            lo[a] = g.min[a] - 0.5 * rec_grid_h(&g, a);
            hi[a] = g.max[a] + 0.5 * rec_grid_h(&g, a);
        }
        h = walk(&g, p, dir);
        T_LE(h.sum, slab(lo, hi, p, dir) * (1 + 1e-6));
        drop(&h);
    }
}

static void one_voxel(void)
{
    struct rec_grid g = {{0, 0, 0}, {1, 1, 1}, {1, 1, 1}, REC_BOX};
    double o[3] = {0.5, 0.5, -4}, d[3] = {0, 0, 1};
    expect(&g, o, d, 1, 1);
    g.basis = REC_TRILINEAR;
    expect(&g, o, d, 1, 1); /* a triangle of base 2 */
}

static void largest_grid(void)
{
    struct rec_grid g = {{0, 0, 0}, {1, 1, 1}, {1024, 1, 1024}, REC_BOX};
    for (int b = 0; b < 2; b++) {
        g.basis = b == 0 ? REC_BOX : REC_TRILINEAR;
        for (int way = 0; way < 2; way++) {
            double o[3] = {way ? 2 : -1, 0.5, way ? 2.0001 : -1.0001};
            double d[3] = {way ? -1 : 1, 0, way ? -1 : 1};
            struct hits h = walk(&g, o, d);
            T_OK(h.n > 1024);
            /* trilinear fades in and out over one voxel at either end */
            T_NEAR(h.sum, sqrt(2) * 0.9999, b == 0 ? 1.5e-6 : sqrt(2) / 1024);
            drop(&h);
        }
    }
}

int main(void)
{
    T_RUN(box_against_every_voxel);
    T_RUN(trilinear_against_quadrature);
    T_RUN(trilinear_against_the_paper);
    T_RUN(trilinear_row_sums);
    T_RUN(misses);
    T_RUN(in_faces_and_edges);
    T_RUN(through_corners);
    T_RUN(camera_inside);
    T_RUN(tiny_and_huge);
    T_RUN(trilinear_adversaries);
    T_RUN(one_voxel);
    T_RUN(largest_grid);
    return t_done();
}
