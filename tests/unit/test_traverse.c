#include "recon/geom/traverse.h"

#include <stdbool.h>
#include "tests/t.h"
#include "tests/lib/centre.h"

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

/* Part of the half line inside [lo,hi], by slabs. */
static bool clip(const double lo[3], const double hi[3], const double o[3], const double d[3],
                 long double s[2])
{
    s[0] = 0;
    s[1] = 1e30L;
    for (int a = 0; a < 3; a++) {
        if (d[a] == 0) {
            if (o[a] < lo[a] || o[a] > hi[a])
                return false;
            continue;
        }
        long double p = ((long double)lo[a] - o[a]) / d[a], q = ((long double)hi[a] - o[a]) / d[a];
        s[0] = fmaxl(s[0], fminl(p, q));
        s[1] = fminl(s[1], fmaxl(p, q));
    }
    return s[1] > s[0];
}

/* Its length. */
static double slab(const double lo[3], const double hi[3], const double o[3], const double d[3])
{
    long double s[2], n2 = 0;
    for (int a = 0; a < 3; a++)
        n2 += (long double)d[a] * d[a];
    return clip(lo, hi, o, d, s) ? (double)((s[1] - s[0]) * sqrtl(n2)) : 0;
}

/* The grid's box grown by half a spacing: what the trilinear basis reaches. */
static void support(const struct rec_grid *g, double lo[3], double hi[3])
{
    for (int a = 0; a < 3; a++) {
        lo[a] = g->min[a] - 0.5 * rec_grid_h(g, a);
        hi[a] = g->max[a] + 0.5 * rec_grid_h(g, a);
    }
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

T_CASE(box_against_every_voxel)
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
    grid_centre(g, i, c);
    for (int a = 0; a < 3; a++)
        v *= fmax(0, 1 - fabs(o[a] + s * d[a] - c[a]) / rec_grid_h(g, a));
    return v;
}

static double length(const double d[3])
{
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

/* Adaptive Simpson: halves are halved again until they agree with their whole.  The first levels are
 * not asked: where phi is 0 at an end, a kink in the first quarter behind it shows in no sample. */
enum { PANELS = 16, DEPTH = 40, UNASKED = 6 };
struct along {
    const struct rec_grid *g;
    int32_t i;
    const double *o, *d;
};
/* What is known of an interval is handed down.  NOLINTNEXTLINE(readability-function-size) */
static double simpson(const struct along *t, double a, double fa, double b, double fb, double m,
                      double fm, double tolerance, int depth)
{
    double l = 0.5 * (a + m), r = 0.5 * (m + b);
    double fl = phi(t->g, t->i, t->o, t->d, l), fr = phi(t->g, t->i, t->o, t->d, r);
    double whole = (b - a) / 6 * (fa + 4 * fm + fb);
    double halves = (b - a) / 12 * (fa + 4 * fl + 2 * fm + 4 * fr + fb);
    if (depth == 0 || (depth <= DEPTH - UNASKED && fabs(halves - whole) <= 15 * tolerance))
        return halves + (halves - whole) / 15;
    return simpson(t, a, fa, m, fm, l, fl, tolerance / 2, depth - 1) +
           simpson(t, m, fm, b, fb, r, fr, tolerance / 2, depth - 1);
}
static double quadrature(const struct rec_grid *g, int32_t i, const double o[3], const double d[3],
                         double s0, double s1, double tolerance)
{
    struct along t = {g, i, o, d};
    double sum = 0;
    for (int p = 0; p < PANELS; p++) {
        double a = s0 + (s1 - s0) * p / PANELS, b = s0 + (s1 - s0) * (p + 1) / PANELS;
        double m = 0.5 * (a + b);
        sum += simpson(&t, a, phi(g, i, o, d, a), b, phi(g, i, o, d, b), m, phi(g, i, o, d, m),
                       tolerance / PANELS, DEPTH);
    }
    return sum;
}

/* Part of the ray inside the support of coefficient i: two spacings a side. */
static bool clip_support(const struct rec_grid *g, int32_t i, const double o[3], const double d[3],
                         long double s[2])
{
    double c[3], lo[3], hi[3];
    grid_centre(g, i, c);
    for (int a = 0; a < 3; a++) {
        lo[a] = c[a] - rec_grid_h(g, a);
        hi[a] = c[a] + rec_grid_h(g, a);
    }
    return clip(lo, hi, o, d, s);
}

/* Every entry of the row, also those that should not be there. */
T_CASE(trilinear_against_quadrature)
{
    double worst = 0;
    size_t entries = 0;
    for (int r = 0; r < 200; r++) {
        struct rec_grid g = random_grid(REC_TRILINEAR);
        double o[3], d[3];
        random_ray(&g, o, d);
        struct hits h = walk(&g, o, d);
        double whole = h.sum / length(d);
        for (int32_t i = 0; i < (int32_t)rec_grid_count(&g); i++) {
            double got = value_at(&h, i), want = 0;
            long double s[2];
            if (clip_support(&g, i, o, d, s))
                want =
                    length(d) * quadrature(&g, i, o, d, (double)s[0], (double)s[1], 1e-14 * whole);
            T_NEAR(got, want, 1e-6 * want + 1e-12 * h.sum);
            if (want > 1e-6 * h.sum) {
                worst = fmax(worst, fabs(got / want - 1));
                entries++;
            }
        }
        drop(&h);
    }
    printf("  %zu entries, worst relative difference %.1e\n", entries, worst);
    T_OK(entries > 1000);
    T_LE(worst, 1e-6);
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

/* The integral of a whole field by the paper's formula, cell by cell; *size: the chord. */
static double paper_integral(const struct rec_grid *g, const double *coeff, const double o[3],
                             const double d[3], double *size)
{
    double want = 0;
    *size = 0;
    for (int32_t k = -1; k < g->n[2]; k++)
        for (int32_t j = -1; j < g->n[1]; j++)
            for (int32_t i = -1; i < g->n[0]; i++) {
                int32_t at[3] = {i, j, k};
                double v[8], p[3], dir[3], lo[3], hi[3];
                long double s[2];
                for (int a = 0; a < 3; a++) {
                    double step = rec_grid_h(g, a);
                    lo[a] = g->min[a] + (at[a] + 0.5) * step;
                    hi[a] = lo[a] + step;
                    p[a] = (o[a] - lo[a]) / step;
                    dir[a] = d[a] / step;
                }
                if (!clip(lo, hi, o, d, s))
                    continue;
                for (int c = 0; c < 8; c++) {
                    int32_t x = i + (c & 1), y = j + (c >> 1 & 1), z = k + (c >> 2);
                    bool in =
                        x >= 0 && y >= 0 && z >= 0 && x < g->n[0] && y < g->n[1] && z < g->n[2];
                    v[c] = in ? coeff[rec_grid_index(g, x, y, z)] : 0;
                }
                /* start in the cell: (22)'s coefficients grow with the cube of p */
                for (int a = 0; a < 3; a++)
                    p[a] += (double)s[0] * dir[a];
                want += length(d) * paper_cell(v, p, dir, 0, (double)(s[1] - s[0]));
                *size += length(d) * (double)(s[1] - s[0]);
            }
    return want;
}

/* Rays in a plane of the dual lattice belong to two of the paper's cells, or four: not those. */
static bool in_a_plane(const struct rec_grid *g, const double o[3], const double d[3])
{
    for (int a = 0; a < 3; a++) {
        double u = (o[a] - g->min[a]) / rec_grid_h(g, a) - 0.5;
        if (d[a] == 0 && fabs(u - floor(u + 0.5)) < 1e-9)
            return true;
    }
    return false;
}

/* The line integral of a random field through S, and through the paper's formula. */
T_CASE(trilinear_against_the_paper)
{
    for (int r = 0; r < 500; r++) {
        struct rec_grid g = random_grid(REC_TRILINEAR);
        double coeff[1000], o[3], d[3], got = 0, size;
        for (size_t i = 0; i < rec_grid_count(&g); i++)
            coeff[i] = t_uniform(-1, 1);
        random_ray(&g, o, d);
        if (in_a_plane(&g, o, d))
            continue;
        struct hits h = walk(&g, o, d);
        for (size_t i = 0; i < h.n; i++)
            got += h.value[i] * coeff[h.index[i]];
        double want = paper_integral(&g, coeff, o, d, &size);
        T_NEAR(got, want, 1e-6 * size + 1e-12);
        drop(&h);
    }
}

/* Entry by entry: the field is one basis function. */
T_CASE(trilinear_entries_against_the_paper)
{
    double worst = 0;
    size_t entries = 0;
    for (int r = 0; r < 60; r++) {
        struct rec_grid g = random_grid(REC_TRILINEAR);
        double coeff[1000] = {0}, o[3], d[3], size;
        random_ray(&g, o, d);
        if (in_a_plane(&g, o, d))
            continue;
        struct hits h = walk(&g, o, d);
        for (size_t i = 0; i < h.n; i++) {
            coeff[h.index[i]] = 1;
            double want = paper_integral(&g, coeff, o, d, &size);
            coeff[h.index[i]] = 0;
            T_NEAR(h.value[i], want, 1e-6 * want + 1e-12 * size);
            if (want > 1e-6 * size) {
                worst = fmax(worst, fabs(h.value[i] / want - 1));
                entries++;
            }
        }
        drop(&h);
    }
    printf("  %zu entries, worst relative difference %.1e\n", entries, worst);
    T_OK(entries > 300);
    T_LE(worst, 1e-6);
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

T_CASE(misses)
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
T_CASE(in_faces_and_edges)
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

T_CASE(through_corners)
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

T_CASE(camera_inside)
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

T_CASE(tiny_and_huge)
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
T_CASE(trilinear_adversaries)
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
        double lo[3], hi[3];
        support(&g, lo, hi);
        h = walk(&g, p, dir);
        T_LE(h.sum, slab(lo, hi, p, dir) * (1 + 1e-6));
        drop(&h);
    }
}

T_CASE(one_voxel)
{
    struct rec_grid g = {{0, 0, 0}, {1, 1, 1}, {1, 1, 1}, REC_BOX};
    double o[3] = {0.5, 0.5, -4}, d[3] = {0, 0, 1};
    expect(&g, o, d, 1, 1);
    g.basis = REC_TRILINEAR;
    expect(&g, o, d, 1, 1); /* a triangle of base 2 */
}

T_CASE(largest_grid)
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

/* Sum of all trilinear functions along the ray: a product of three clamps, integrated exactly between
 * its kinks by Simpson's rule, which is exact for cubics. */
static double partition(const struct rec_grid *g, const double o[3], const double d[3])
{
    double cut[16], lo[3], hi[3], sum = 0;
    long double ends[2];
    size_t n = 0;
    support(g, lo, hi);
    if (!clip(lo, hi, o, d, ends))
        return 0;
    cut[n++] = (double)ends[0];
    for (int a = 0; a < 3; a++)
        for (int side = 0; side < 4 && d[a] != 0; side++) {
            double h = rec_grid_h(g, a);
            double at = side < 2 ? g->min[a] + (side - 0.5) * h : g->max[a] + (side - 2.5) * h;
            double s = (at - o[a]) / d[a];
            if (s > cut[0] && s < (double)ends[1])
                cut[n++] = s;
        }
    cut[n++] = (double)ends[1];
    for (size_t i = 1; i < n; i++) /* sort */
        for (size_t k = i; k > 0 && cut[k] < cut[k - 1]; k--) {
            double swap = cut[k];
            cut[k] = cut[k - 1];
            cut[k - 1] = swap;
        }
    for (size_t i = 0; i + 1 < n; i++)
        for (int q = 0; q < 3; q++) {
            double s = cut[i] + (cut[i + 1] - cut[i]) * q / 2, v = 1;
            for (int a = 0; a < 3; a++) {
                double u = (o[a] + s * d[a] - g->min[a]) / rec_grid_h(g, a) + 0.5;
                v *= fmax(0, fmin(1, fmin(u, g->n[a] + 1 - u)));
            }
            sum += v * (cut[i + 1] - cut[i]) * (q == 1 ? 4 : 1) / 6;
        }
    return sum * length(d);
}

/* A point on the lattice of faces (or centres), up to `ulps` roundings off it. */
static double on_lattice(const struct rec_grid *g, int a, bool centres, int ulps)
{
    double u = 1 + (double)(t_rand() % (uint64_t)(g->n[a] > 1 ? g->n[a] - 1 : 1));
    double x = g->min[a] + (g->n[a] > 1 ? u - (centres ? 0.5 : 0) : 0.5) * rec_grid_h(g, a);
    for (int i = 0; i < abs(ulps); i++)
        x = nextafter(x, ulps < 0 ? -1e300 : 1e300);
    return x;
}

/* Any ray, any grid, any camera position: grids up to hundreds of voxels a side and as flat as they
 * come; cameras near, far, inside and on planes; rays through lattice points, in planes and a few
 * roundings beside them.  Nothing is lost and nothing counted twice: the row sums to the chord. */
T_CASE(watertight)
{
    double worst[2] = {0};
    int rays[2] = {0};
    for (int r = 0; r < 6000; r++) {
        enum rec_basis basis = r % 2 == 0 ? REC_BOX : REC_TRILINEAR;
        struct rec_grid g = random_grid(basis);
        for (int a = 0; a < 3; a++)
            g.n[a] = (int32_t)pow(2, t_uniform(0, a == r % 3 ? 9 : 5));
        double o[3], aim[3], d[3], far = pow(10, t_uniform(0, 5));
        int place = (int)(t_rand() % 5), target = (int)(t_rand() % 3);
        for (int a = 0; a < 3; a++) {
            double size = g.max[a] - g.min[a];
            int ulps = (int)(t_rand() % 5) - 2;
            aim[a] = target == 0 ? g.min[a] + size * t_uniform(0.01, 0.99)
                                 : on_lattice(&g, a, target == 2, ulps);
            switch (place) {
            case 0: o[a] = g.min[a] + size * t_uniform(-1.5, 2.5); break;          /* near */
            case 1: o[a] = aim[a] + size * far * t_normal(); break;                /* far */
            case 2: o[a] = g.min[a] + size * t_uniform(0, 1); break;               /* inside */
            case 3: o[a] = on_lattice(&g, a, false, ulps); break;                  /* on planes */
            default: o[a] = aim[a] + (a == r / 2 % 3 ? -2 * far * size : 0) + 0.0; /* in planes */
            }
            d[a] = aim[a] - o[a];
        }
        if (place == 4 && t_rand() % 2) /* and only just not */
            d[(r / 2 + 1) % 3] = 1e-15 * t_normal() * fabs(d[r / 2 % 3]);
        if (d[0] == 0 && d[1] == 0 && d[2] == 0)
            continue;
        struct hits h = walk(&g, o, d);
        double want = basis == REC_BOX ? slab(g.min, g.max, o, d) : partition(&g, o, d);
        /* What the camera's own coordinates can say: their rounding, seen along the ray. */
        double reach = 0;
        for (int a = 0; a < 3; a++)
            reach = fmax(reach, fabs(o[a]) + fabs(g.max[a]) + fabs(g.min[a]));
        T_NEAR(h.sum, want, 1e-6 * want + 1e-14 * reach);
        if (want > 1e-6 * reach) {
            worst[basis] = fmax(worst[basis], fabs(h.sum / want - 1));
            rays[basis]++;
        }
        drop(&h);
    }
    for (int b = 0; b < 2; b++) {
        printf("  %s: %d rays, worst relative difference %.1e\n", rec_basis_name((enum rec_basis)b),
               rays[b], worst[b]);
        T_OK(rays[b] > 1500);
        T_LE(worst[b], 1e-6);
    }
}

/* A ray cut in two sees in both parts together what it sees uncut; behind the end there is nothing. */
T_CASE(cut_where_a_surface_is)
{
    for (int t = 0; t < 400; t++) {
        struct rec_grid g = {{-0.5, -0.5, 0}, {0.5, 0.7, 1}, {9, 7, 8}, REC_BOX};
        g.basis = t % 2 == 0 ? REC_BOX : REC_TRILINEAR;
        double o[3], d[3], at[3], len = 0, cut = t_uniform(0, 3), first = 0;
        for (int a = 0; a < 3; a++) {
            o[a] = t_uniform(-1, 1);
            d[a] = t_uniform(-0.4, 0.4) - o[a];
            len += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            at[a] = o[a] + cut * d[a] / sqrt(len);
        size_t max = rec_traverse_max(&g), n;
        int32_t *index = malloc(max * sizeof *index);
        float *value = malloc(max * sizeof *value);
        float *sum = calloc(rec_grid_count(&g), sizeof *sum);
        struct hits all = walk(&g, o, d), rest = walk(&g, at, d);
        n = rec_traverse_until(&g, o, d, cut, index, value);
        T_LE(n, max);
        for (size_t i = 0; i < n; i++) {
            sum[index[i]] += value[i];
            first += value[i];
        }
        for (size_t i = 0; i < rest.n; i++)
            sum[rest.index[i]] += rest.value[i];
        for (int32_t i = 0; i < (int32_t)rec_grid_count(&g); i++)
            T_NEAR(sum[i], value_at(&all, i), 1e-6);
        T_LE(first, cut * (1 + 1e-6));
        T_EQ_I(rec_traverse_until(&g, o, d, 0, index, value), 0);
        T_EQ_I(rec_traverse_until(&g, o, d, NAN, index, value), 0);
        T_EQ_I(rec_traverse_until(&g, o, d, INFINITY, index, value), all.n);
        drop(&all);
        drop(&rest);
        free(index);
        free(value);
        free(sum);
    }
}
