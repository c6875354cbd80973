/* A closed surface of triangles and its tree: boxes halved at the median of the triangles' middles
 * along the longest side, until a few are left. */
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/mem.h"
#include "recon/geom/body.h"

#define LEAF 4

struct node {
    double min[3], max[3];
    uint32_t first, n; /* triangles of a leaf; n = 0: children are the next node and `first` */
};

struct rec_mesh {
    atomic_int owners;
    size_t n, nodes;
    double (*corner)[3][3]; /* [n], in the order of the tree */
    struct node *node;
};

/* ---- closed? ------------------------------------------------------------------------------------ */

struct edge {
    double end[2][3]; /* the smaller corner first */
    int dir;          /* +1: the triangle runs along the edge from the first end; -1: against it */
};

static int order_edges(const void *a, const void *b)
{
    const double *p = &((const struct edge *)a)->end[0][0];
    const double *q = &((const struct edge *)b)->end[0][0];
    for (int i = 0; i < 6; i++)
        if (p[i] != q[i])
            return p[i] < q[i] ? -1 : 1;
    return 0;
}

static struct edge edge_of(const double a[3], const double b[3])
{
    struct edge e = {.dir = 1};
    int i = 0;
    while (i < 3 && a[i] == b[i])
        i++;
    e.dir = i == 3 ? 0 : a[i] < b[i] ? 1 : -1;
    for (int k = 0; k < 3; k++) { /* -0 and 0 are the same place */
        e.end[e.dir < 0][k] = a[k] + 0.0;
        e.end[e.dir >= 0][k] = b[k] + 0.0;
    }
    return e;
}

/* The surface is closed if every edge is used equally often in both directions. */
static pvx_err mesh_closed(const double (*corner)[3][3], size_t n, struct pvx_diag *d)
{
    struct edge *e = pvx_calloc(3 * n, sizeof *e);
    size_t m = 0, open = 0;
    if (e == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            e[m] = edge_of(corner[i][k], corner[i][(k + 1) % 3]);
            m += e[m].dir != 0;
        }
    qsort(e, m, sizeof *e, order_edges);
    for (size_t i = 0, j; i < m; i = j) {
        int sum = 0;
        for (j = i; j < m && order_edges(&e[i], &e[j]) == 0; j++)
            sum += e[j].dir;
        open += sum != 0;
    }
    free(e);
    if (open == 0)
        return PVX_OK;
    return pvx_fail(
        d, PVX_EINVAL,
        "the surface is not closed: %zu edges belong to one triangle only or to two that "
        "face different sides; fill its holes and make its normals point outwards",
        open);
}

/* ---- the tree ----------------------------------------------------------------------------------- */

static double mesh_middle(const double t[3][3], int axis)
{
    return t[0][axis] + t[1][axis] + t[2][axis];
}

static void mesh_swap(double (*t)[3][3], size_t i, size_t j)
{
    double keep[3][3];
    memcpy(keep, t[i], sizeof keep);
    memcpy(t[i], t[j], sizeof keep);
    memcpy(t[j], keep, sizeof keep);
}

/* Moves the half of the triangles with the smaller middles along `axis` to the front: C. A. R. Hoare's FIND, 1961. */
static void halve(double (*t)[3][3], size_t n, int axis)
{
    size_t lo = 0, hi = n - 1, k = n / 2;
    while (lo < hi) {
        double pivot = mesh_middle((const double(*)[3])t[lo + (hi - lo) / 2], axis);
        size_t i = lo, j = hi;
        while (i <= j) {
            while (mesh_middle((const double(*)[3])t[i], axis) < pivot)
                i++;
            while (mesh_middle((const double(*)[3])t[j], axis) > pivot)
                j--;
            if (i > j)
                break;
            mesh_swap(t, i++, j);
            if (j == 0)
                break;
            j--;
        }
        if (k <= j)
            hi = j;
        else if (k >= i)
            lo = i;
        else
            return;
    }
}

/* The depth is log2 of the number of triangles, 20. */
// NOLINTNEXTLINE(misc-no-recursion)
static void mesh_grow(struct rec_mesh *m, size_t first, size_t n)
{
    struct node *at = &m->node[m->nodes++];
    int axis = 0;
    for (int a = 0; a < 3; a++) {
        at->min[a] = INFINITY;
        at->max[a] = -INFINITY;
        for (size_t i = 3 * first; i < 3 * (first + n); i++) {
            at->min[a] = fmin(at->min[a], m->corner[i / 3][i % 3][a]);
            at->max[a] = fmax(at->max[a], m->corner[i / 3][i % 3][a]);
        }
        if (at->max[a] - at->min[a] > at->max[axis] - at->min[axis])
            axis = a;
    }
    at->first = (uint32_t)first;
    at->n = (uint32_t)n;
    if (n <= LEAF)
        return;
    halve(m->corner + first, n, axis);
    at->n = 0;
    mesh_grow(m, first, n / 2);
    at->first = (uint32_t)m->nodes;
    mesh_grow(m, first + n / 2, n - n / 2);
}

pvx_err rec_mesh_new(const double *corners, size_t n, struct rec_mesh **out, struct pvx_diag *d)
{
    *out = NULL;
    if (n == 0)
        return pvx_fail(d, PVX_EINVAL, "there is no triangle in it");
    if (n > REC_MESH_MAX)
        return pvx_fail(d, PVX_EINVAL,
                        "%zu triangles are more than %d; simplify the mesh, a voxel sees no more",
                        n, REC_MESH_MAX);
    for (size_t i = 0; i < 9 * n; i++)
        if (!isfinite(corners[i]))
            return pvx_fail(d, PVX_EINVAL,
                            "corner %zu of triangle %zu is not a number; export the mesh again",
                            i / 3 % 3 + 1, i / 9 + 1);
    PVX_TRY(mesh_closed((const double(*)[3][3])corners, n, d));
    struct rec_mesh *m = pvx_calloc(1, sizeof *m);
    if (m == NULL)
        return PVX_ENOMEM;
    atomic_init(&m->owners, 1);
    m->n = n;
    m->corner = pvx_calloc(n, sizeof *m->corner);
    m->node = pvx_calloc(2 * n, sizeof *m->node);
    if (m->corner == NULL || m->node == NULL) {
        rec_mesh_free(&m);
        return PVX_ENOMEM;
    }
    memcpy(m->corner, corners, n * sizeof *m->corner);
    mesh_grow(m, 0, n);
    *out = m;
    return PVX_OK;
}

struct rec_mesh *rec_mesh_share(struct rec_mesh *m)
{
    atomic_fetch_add(&m->owners, 1);
    return m;
}

void rec_mesh_free(struct rec_mesh **pm)
{
    struct rec_mesh *m = *pm;
    *pm = NULL;
    if (m == NULL || atomic_fetch_sub(&m->owners, 1) > 1)
        return;
    free(m->corner);
    free(m->node);
    free(m);
}

/* ---- questions ---------------------------------------------------------------------------------- */

/* Distance at which the ray enters the node; INFINITY: not before `end`. */
static double enters(const struct node *n, const double o[3], const double inv[3], double end)
{
    double s0 = 0, s1 = end;
    for (int a = 0; a < 3; a++) {
        double u = (n->min[a] - o[a]) * inv[a], v = (n->max[a] - o[a]) * inv[a];
        if (isnan(u) || isnan(v)) /* the ray runs in the plane of a face */
            continue;
        s0 = fmax(s0, fmin(u, v));
        s1 = fmin(s1, fmax(u, v));
    }
    return s0 <= s1 * (1 + 1e-12) + 1e-12 ? s0 : INFINITY;
}

/* A triangle reaches a little beyond its edges, so that no ray slips through between two triangles. */
static double triangle_hit(const double t[3][3], const double o[3], const double d[3])
{
    const double slack = 1e-9;
    double e[3], f[3], s[3];
    for (int a = 0; a < 3; a++) {
        e[a] = t[1][a] - t[0][a];
        f[a] = t[2][a] - t[0][a];
        s[a] = o[a] - t[0][a];
    }
    double p[3] = {d[1] * f[2] - d[2] * f[1], d[2] * f[0] - d[0] * f[2], d[0] * f[1] - d[1] * f[0]};
    double q[3] = {s[1] * e[2] - s[2] * e[1], s[2] * e[0] - s[0] * e[2], s[0] * e[1] - s[1] * e[0]};
    double det = e[0] * p[0] + e[1] * p[1] + e[2] * p[2];
    if (det == 0) /* seen edge on: the ray hits its neighbours */
        return INFINITY;
    double u = (s[0] * p[0] + s[1] * p[1] + s[2] * p[2]) / det;
    double v = (d[0] * q[0] + d[1] * q[1] + d[2] * q[2]) / det;
    double at = (f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) / det;
    return u >= -slack && v >= -slack && u + v <= 1 + slack && at >= 0 ? at : INFINITY;
}

double rec_mesh_hit(const struct rec_mesh *m, const double o[3], const double d[3])
{
    double inv[3] = {1 / d[0], 1 / d[1], 1 / d[2]}, first = INFINITY;
    uint32_t stack[64], top = 0;
    stack[top++] = 0;
    while (top > 0) {
        uint32_t i = stack[--top];
        const struct node *n = &m->node[i];
        if (enters(n, o, inv, first) == INFINITY)
            continue;
        for (size_t k = n->first; k < (size_t)n->first + n->n; k++)
            first = fmin(first, triangle_hit((const double(*)[3])m->corner[k], o, d));
        if (n->n != 0)
            continue;
        stack[top++] = n->first;
        stack[top++] = i + 1;
    }
    return first;
}

/* The sum of the solid angles over 4 pi is 1 inside (or -1, with normals inwards) and 0 outside. */
bool rec_mesh_inside(const struct rec_mesh *m, const double x[3])
{
    double sum = 0;
    for (size_t i = 0; i < m->n; i++) {
        double v[3][3], len[3];
        for (int k = 0; k < 3; k++) {
            for (int a = 0; a < 3; a++)
                v[k][a] = m->corner[i][k][a] - x[a];
            len[k] = sqrt(v[k][0] * v[k][0] + v[k][1] * v[k][1] + v[k][2] * v[k][2]);
        }
        double det = v[0][0] * (v[1][1] * v[2][2] - v[1][2] * v[2][1]) -
                     v[0][1] * (v[1][0] * v[2][2] - v[1][2] * v[2][0]) +
                     v[0][2] * (v[1][0] * v[2][1] - v[1][1] * v[2][0]);
        double w = len[0] * len[1] * len[2];
        for (int k = 0; k < 3; k++) {
            const double *p = v[k], *q = v[(k + 1) % 3];
            w += (p[0] * q[0] + p[1] * q[1] + p[2] * q[2]) * len[(k + 2) % 3];
        }
        sum += 2 * atan2(det, w);
    }
    return fabs(sum) > 6.283185307179586; /* half of 4 pi */
}

void rec_mesh_box(const struct rec_mesh *m, double min[3], double max[3])
{
    memcpy(min, m->node[0].min, sizeof m->node[0].min);
    memcpy(max, m->node[0].max, sizeof m->node[0].max);
}

uint64_t rec_mesh_hash(const struct rec_mesh *m)
{
    return XXH3_64bits(m->corner, m->n * sizeof *m->corner);
}
