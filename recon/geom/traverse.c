#include "recon/geom/traverse.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>

/* One axis of a lattice of planes, in the order in which the ray meets them.  The coordinate, in units of the spacing
 * from the first plane, is A + B s with B >= 0, so plane m is crossed at s = (m - A) c, c = 1/B.  It is computed from
 * m each time and never summed up; rounding is monotonic in m. */
struct axis {
    double A, B, c;
    int32_t n; /* cells */
    int32_t m; /* plane that the ray meets next; it is in cell m-1 */
};

/* 24 KiB.  Per axis only the crossings in [lo-1, hi] are filled, then a sentinel. */
struct walk {
    struct axis ax[3];
    double t[3][REC_GRID_MAX + 4];
    double s0, s1, scale; /* the part of the ray inside; metres per unit of s */
};

size_t rec_traverse_max(const struct rec_grid *g)
{
    size_t sum = (size_t)g->n[0] + (size_t)g->n[1] + (size_t)g->n[2];
    /* box: one per cell met; trilinear: 8 corners, 4 more with each of the (n+1)^3 cells.  The box
     * walk writes one slot ahead. */
    return g->basis == REC_TRILINEAR ? 4 * (sum + 3) + 8 : sum + 1;
}

static double crossing(const struct axis *a, int32_t m)
{
    return (m - a->A) * a->c;
}

/* Cell of a coordinate that is constant along the ray.  A face belongs to the cell on its upper side, the last face
 * to the one on its lower side.  The planes are at first + m h; the division alone may miss that by one rounding. */
static int32_t fixed_cell(double x, double first, double h, int32_t n)
{
    double q = floor((x - first) / h);
    int32_t m = q < 0 ? 0 : q > n - 1 ? n - 1 : (int32_t)q;
    if (m + 1 < n && x >= first + (m + 1) * h)
        m++;
    if (m > 0 && x < first + m * h)
        m--;
    return m;
}

/* Clips the first `length` metres of the half line against a lattice with `extra` more cells than the grid, half of
 * them on either side, and finds the cell where it starts.  False: misses. */
static bool traverse_start(const struct rec_grid *g, int32_t extra, const double origin[3],
                           const double dir[3], double length, struct walk *w)
{
    for (int a = 0; a < 3; a++)
        if (!isfinite(origin[a]) || !isfinite(dir[a]))
            return false;
    double big = 0, d[3] = {dir[0], dir[1], dir[2]};
    for (int a = 0; a < 3; a++)
        big = fabs(dir[a]) > big ? fabs(dir[a]) : big;
    if (!(big > 0))
        return false;
    if (big < 1e-3 ||
        big > 1e3) { /* bring it near 1, so that squares neither over- nor underflow */
        int exponent;
        frexp(big, &exponent);
        for (int a = 0; a < 3; a++)
            d[a] = ldexp(dir[a], -exponent);
    }
    w->scale = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    w->s0 = 0;
    w->s1 = length / w->scale;
    for (int a = 0; a < 3; a++) {
        struct axis *x = &w->ax[a];
        double h = rec_grid_h(g, a), pad = 0.5 * extra * h;
        double first = g->min[a] - pad, last = g->max[a] + pad;
        bool parallel = fabs(d[a]) < 1e-100; /* moves by less than one rounding across any grid */
        x->n = g->n[a] + extra;
        x->m = 1;
        x->A = d[a] < 0 && !parallel ? (last - origin[a]) / h : (origin[a] - first) / h;
        x->B = parallel ? 0 : fabs(d[a]) / h;
        if (parallel) {
            if (!(origin[a] >= first && origin[a] <= last))
                return false;
            x->m = fixed_cell(origin[a], first, h, x->n) + 1;
            continue;
        }
        x->c = h / fabs(d[a]);
        double near = crossing(x, 0), far = crossing(x, x->n);
        w->s0 = near > w->s0 ? near : w->s0;
        w->s1 = far < w->s1 ? far : w->s1;
    }
    if (!(w->s0 < w->s1) || !isfinite(w->s1))
        return false;
    for (int a = 0; a < 3; a++) {
        struct axis *x = &w->ax[a];
        if (x->B == 0) {
            w->t[a][x->m] = INFINITY;
            continue;
        }
        double u = floor(x->A + x->B * w->s0), v = floor(x->A + x->B * w->s1) + 2;
        int32_t m = u < 0 ? 1 : u > x->n - 1 ? x->n : (int32_t)u + 1;
        while (m < x->n && crossing(x, m) <= w->s0)
            m++;
        while (m > 1 && crossing(x, m - 1) > w->s0)
            m--;
        x->m = m;
        int32_t end = v < m ? m : v > x->n ? x->n : (int32_t)v;
        for (; m <= end; m++)
            w->t[a][m] = crossing(x, m);
        w->t[a][m] = INFINITY; /* sentinel, never reached because s1 comes first */
    }
    return true;
}

/* Change of the grid index from one cell to the next along axis a of the ray. */
static int32_t step_of(const struct rec_grid *g, const double dir[3], int a)
{
    int32_t stride = a == 0 ? 1 : a == 1 ? g->n[0] : g->n[0] * g->n[1];
    return dir[a] < 0 ? -stride : stride;
}

static size_t walk_box(const struct rec_grid *g, const double origin[3], const double dir[3],
                       double length, int32_t *index, float *value)
{
    struct walk w;
    if (!traverse_start(g, 0, origin, dir, length, &w))
        return 0;
    int32_t step[3], cur = 0;
    const double *t[3]; /* next crossing of each axis */
    for (int a = 0; a < 3; a++) {
        const struct axis *x = &w.ax[a];
        step[a] = step_of(g, dir, a);
        bool mirrored = dir[a] < 0 && x->B > 0;
        int32_t cell = mirrored ? x->n - x->m : x->m - 1;
        cur += cell * (step[a] < 0 ? -step[a] : step[a]);
        t[a] = &w.t[a][x->m];
    }
    size_t n = 0;
    double s = w.s0, scale = w.scale;
    const double s1 = w.s1;
    const double *tx = t[0], *ty = t[1], *tz = t[2];
    const int32_t dx = step[0], dy = step[1], dz = step[2];
    /* No branch depends on which plane comes next, because the CPU could not predict it. */
    while (s < s1) {
        double a = *tx, b = *ty, c = *tz;
        double bc = b <= c ? b : c;
        double e = a <= bc ? a : bc;
        e = e < s1 ? e : s1;
        float v = (float)((e - s) * scale);
        index[n] = cur;
        value[n] = v;
        n += v >= FLT_MIN;
        int x = a <= bc, y = !x & (b <= c), z = !x & !y;
        tx += x;
        ty += y;
        tz += z;
        cur += (dx & -x) | (dy & -y) | (dz & -z);
        s = e;
    }
    return n;
}

/* The eight corners of the cell that the ray is in, with their sums so far.  Bit a of a corner's number: 0 = the side
 * that the ray leaves behind along axis a, 1 = the side ahead. */
struct corners {
    double sum[8];
    int32_t
        plane[3]; /* lattice plane (= centre) of side 0, in the ray's order; 1..n are in the grid */
    int32_t index; /* grid index of corner 0, meaningful for corners in the grid only */
    int32_t step[3], n[3];
};

static size_t traverse_emit(const struct corners *k, int corner, size_t n, int32_t *index,
                            float *value)
{
    float v = (float)k->sum[corner];
    if (!(v >= FLT_MIN))
        return n;
    int32_t at = k->index;
    for (int a = 0; a < 3; a++) {
        int side = corner >> a & 1, plane = k->plane[a] + side;
        if (plane < 1 || plane > k->n[a])
            return n; /* no basis function there */
        at += side * k->step[a];
    }
    index[n] = at;
    value[n] = v;
    return n + 1;
}

/* Leaves the cell through the plane ahead along axis a.  The four corners behind are complete, because the ray never
 * turns back; the four ahead become those behind. */
static size_t traverse_advance(struct corners *k, int a, size_t n, int32_t *index, float *value)
{
    for (int c = 0; c < 8; c++)
        if (!(c >> a & 1)) {
            n = traverse_emit(k, c, n, index, value);
            k->sum[c] = k->sum[c | 1 << a];
            k->sum[c | 1 << a] = 0;
        }
    k->plane[a]++;
    k->index += k->step[a];
    return n;
}

static double clamp01(double f)
{
    return f < 0 ? 0 : f > 1 ? 1 : f;
}

/* Along s a corner's weight is a product of three linear functions, paper (22): a cubic, which Gauss'
 * rule with two points integrates exactly.  It is better conditioned than the expanded polynomial:
 * every term is >= 0, so nothing cancels. */
static void traverse_integrate(const struct walk *w, struct corners *k, double s, double e)
{
    static const double gauss = 0.28867513459481287; /* 1/(2 sqrt 3) */
    double mid = 0.5 * (s + e), len = e - s, half = 0.5 * len * w->scale;
    for (int i = 0; i < 2; i++) {
        double at = mid + (i == 0 ? -gauss : gauss) * len, f[3];
        for (int a = 0; a < 3; a++)
            f[a] = clamp01(w->ax[a].A + w->ax[a].B * at - k->plane[a]);
        double x1 = f[0], x0 = 1 - x1, y1 = f[1], y0 = 1 - y1;
        double z1 = f[2] * half, z0 = (1 - f[2]) * half;
        double y0z0 = y0 * z0, y1z0 = y1 * z0, y0z1 = y0 * z1, y1z1 = y1 * z1;
        k->sum[0] += x0 * y0z0;
        k->sum[1] += x1 * y0z0;
        k->sum[2] += x0 * y1z0;
        k->sum[3] += x1 * y1z0;
        k->sum[4] += x0 * y0z1;
        k->sum[5] += x1 * y0z1;
        k->sum[6] += x0 * y1z1;
        k->sum[7] += x1 * y1z1;
    }
}

static size_t walk_trilinear(const struct rec_grid *g, const double origin[3], const double dir[3],
                             double length, int32_t *index, float *value)
{
    struct walk w;
    if (!traverse_start(g, 1, origin, dir, length,
                        &w)) /* cells of the lattice of centres, one rim outside */
        return 0;
    struct corners k = {.sum = {0}};
    for (int a = 0; a < 3; a++) {
        const struct axis *x = &w.ax[a];
        bool mirrored = dir[a] < 0 && x->B > 0;
        int32_t stride = a == 0 ? 1 : a == 1 ? g->n[0] : g->n[0] * g->n[1];
        k.n[a] = g->n[a];
        k.plane[a] = x->m - 1;
        k.step[a] = mirrored ? -stride : stride;
        /* plane p is centre p-1, or n-p when the axis is met from above */
        k.index += (mirrored ? g->n[a] - k.plane[a] : k.plane[a] - 1) * stride;
    }
    const double *tx = &w.t[0][w.ax[0].m], *ty = &w.t[1][w.ax[1].m], *tz = &w.t[2][w.ax[2].m];
    size_t n = 0;
    for (double s = w.s0; s < w.s1;) {
        double a = *tx, b = *ty, c = *tz;
        double bc = b <= c ? b : c;
        double e = a <= bc ? a : bc;
        e = e < w.s1 ? e : w.s1;
        if (e > s)
            traverse_integrate(&w, &k, s, e);
        s = e;
        if (!(s < w.s1))
            break;
        if (a <= bc) {
            n = traverse_advance(&k, 0, n, index, value);
            tx++;
        } else if (b <= c) {
            n = traverse_advance(&k, 1, n, index, value);
            ty++;
        } else {
            n = traverse_advance(&k, 2, n, index, value);
            tz++;
        }
    }
    for (int c = 0; c < 8; c++)
        n = traverse_emit(&k, c, n, index, value);
    return n;
}

size_t rec_traverse_until(const struct rec_grid *g, const double origin[3], const double dir[3],
                          double length, int32_t *index, float *value)
{
    return g->basis == REC_TRILINEAR ? walk_trilinear(g, origin, dir, length, index, value)
                                     : walk_box(g, origin, dir, length, index, value);
}

size_t rec_traverse(const struct rec_grid *g, const double origin[3], const double dir[3],
                    int32_t *index, float *value)
{
    return rec_traverse_until(g, origin, dir, INFINITY, index, value);
}
