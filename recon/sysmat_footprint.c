/* Footprints: where the support of each basis function can appear in a camera's image.
 *
 * The support is a box whose corners are planes of one lattice, so the lattice is projected once and
 * every box looks up its eight corners.  A pinhole maps the box into the hull of its corners; a lens
 * bends that hull's edges.  For f with second derivatives up to M, a point inside a polygon of
 * diameter D has f <= max over the corners + M D^2/4 (interpolate along a chord to two edge points,
 * then along the edges); M D is bounded by what the Jacobian changes over the corners, times 2 for
 * what the corners do not show. */
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/sysmat_priv.h"

#define SLAB 8 /* layers of voxels per task */

struct job {
    const rec_sysmat *m;
    const struct rec_camera *c;
    const struct rec_sysmat_block *b;
    const struct rec_sysmat_part *part;
    struct rec_rect *fp;
    int32_t span;   /* lattice cells per support: 1 box, 2 trilinear */
    int32_t nx, ny; /* lattice points per layer */
    atomic_bool out_of_memory;
};

struct point {
    struct rec_projection p;
    bool ok;
};

static const struct rec_rect unseen = {1, 1, 0, 0};

/* Lattice plane i along an axis: the faces of the cells, or for trilinear the centres with one more
 * at either end. */
static double plane(const struct rec_grid *g, int a, int32_t i)
{
    return g->min[a] + (g->basis == REC_TRILINEAR ? i - 0.5 : i) * rec_grid_h(g, a);
}

static void project_layer(const struct job *j, int32_t k, struct point *layer)
{
    const struct rec_grid *g = &j->m->grid;
    for (int32_t y = 0; y < j->ny; y++)
        for (int32_t x = 0; x < j->nx; x++) {
            struct point *p = &layer[(size_t)y * (size_t)j->nx + (size_t)x];
            double X[3] = {plane(g, 0, x), plane(g, 1, y), plane(g, 2, k)};
            p->ok = rec_camera_project_full(j->c, X, &p->p);
        }
}

struct range {
    double lo, hi;
};

static void widen(struct range *r, double v)
{
    r->lo = v < r->lo ? v : r->lo; /* fmin is a call, and this runs 64 times per voxel */
    r->hi = v > r->hi ? v : r->hi;
}

/* Bins of the pixel range [lo,hi], clipped to `n` bins; false when it lies outside. */
static bool bins(struct range px, int32_t binning, int32_t n, uint16_t *first, uint16_t *last)
{
    double a = floor((px.lo + 0.5) / binning), b = floor((px.hi + 0.5) / binning);
    if (!(b >= 0) || !(a < n))
        return false;
    *first = (uint16_t)(a < 0 ? 0 : a);
    *last = (uint16_t)(b > n - 1 ? n - 1 : b);
    return true;
}

/* All corners in front of the camera: the rectangle of the support, grown for the lens. */
static struct rec_rect rectangle(const struct job *j, const struct point *const corner[8])
{
    const struct rec_projection *q0 = &corner[0]->p;
    struct range u = {q0->u, q0->u}, v = {q0->v, q0->v}, x = {q0->x, q0->x}, y = {q0->y, q0->y};
    struct range J[4];
    for (int q = 0; q < 4; q++)
        J[q] = (struct range){q0->J[q], q0->J[q]};
    for (int i = 1; i < 8; i++) {
        const struct rec_projection *p = &corner[i]->p;
        widen(&u, p->u);
        widen(&v, p->v);
        widen(&x, p->x);
        widen(&y, p->y);
        for (int q = 0; q < 4; q++)
            widen(&J[q], p->J[q]);
    }
    double dx = x.hi - x.lo, dy = y.hi - y.lo, D = sqrt(dx * dx + dy * dy);
    double bend_u = 0.5 * D * (J[0].hi - J[0].lo + J[1].hi - J[1].lo) + 1e-6;
    double bend_v = 0.5 * D * (J[2].hi - J[2].lo + J[3].hi - J[3].lo) + 1e-6;
    u.lo -= bend_u;
    u.hi += bend_u;
    v.lo -= bend_v;
    v.hi += bend_v;
    struct rec_rect r;
    if (!bins(u, j->m->binning, j->b->bw, &r.x0, &r.x1) ||
        !bins(v, j->m->binning, j->b->bh, &r.y0, &r.y1))
        return unseen;
    return r;
}

/* Rectangle with the rows of column `col` added: holds by construction then. */
static struct rec_rect with_entries(const struct job *j, size_t col, struct rec_rect r)
{
    uint32_t e0 = j->part->colptr[col], e1 = j->part->colptr[col + 1];
    const uint32_t *row = j->part->row;
    if (e0 == e1)
        return r;
    uint32_t bw = (uint32_t)j->b->bw, y = row[e0] / bw, base = y * bw;
    uint32_t x0 = UINT32_MAX, x1 = 0, y0 = y;
    if (rec_rect_seen(r)) {
        x0 = r.x0;
        x1 = r.x1;
    }
    for (uint32_t e = e0; e < e1; e++) {
        while (row[e] - base >= bw) { /* rows ascend: cheaper than dividing */
            base += bw;
            y++;
        }
        uint32_t x = row[e] - base;
        x0 = x < x0 ? x : x0;
        x1 = x > x1 ? x : x1;
    }
    if (rec_rect_seen(r)) {
        y0 = r.y0 < y0 ? r.y0 : y0;
        y = r.y1 > y ? r.y1 : y;
    }
    return (struct rec_rect){(uint16_t)x0, (uint16_t)y0, (uint16_t)x1, (uint16_t)y};
}

static struct rec_rect footprint(const struct job *j, size_t col, const struct point *const c[8])
{
    int ok = 0;
    for (int i = 0; i < 8; i++)
        ok += c[i]->ok;
    if (ok == 8)
        return with_entries(j, col, rectangle(j, c));
    /* partly behind the camera or past the fold of the lens: its outline is not known */
    if (j->part->colptr[col] == j->part->colptr[col + 1])
        return unseen;
    return (struct rec_rect){0, 0, (uint16_t)(j->b->bw - 1), (uint16_t)(j->b->bh - 1)};
}

static void slab(void *ctx, size_t task)
{
    struct job *j = ctx;
    const struct rec_grid *g = &j->m->grid;
    size_t per_layer = (size_t)j->nx * (size_t)j->ny;
    int32_t planes = j->span + 1, k0 = (int32_t)task * SLAB;
    int32_t k1 = k0 + SLAB < g->n[2] ? k0 + SLAB : g->n[2];
    struct point *ring = malloc((size_t)planes * per_layer * sizeof *ring);
    if (ring == NULL) {
        atomic_store(&j->out_of_memory, true);
        return;
    }
    for (int32_t k = k0; k < k0 + j->span; k++)
        project_layer(j, k, ring + (size_t)(k % planes) * per_layer);
    for (int32_t k = k0; k < k1; k++) {
        int32_t far = k + j->span;
        project_layer(j, far, ring + (size_t)(far % planes) * per_layer);
        for (int32_t y = 0; y < g->n[1]; y++)
            for (int32_t x = 0; x < g->n[0]; x++) {
                const struct point *c[8];
                for (int i = 0; i < 8; i++) {
                    int32_t cx = x + (i & 1) * j->span, cy = y + (i >> 1 & 1) * j->span;
                    int32_t cz = (k + (i >> 2) * j->span) % planes;
                    c[i] = ring + (size_t)cz * per_layer + (size_t)cy * (size_t)j->nx + (size_t)cx;
                }
                size_t col = (size_t)rec_grid_index(g, x, y, k);
                j->fp[col] = footprint(j, col, c);
            }
    }
    free(ring);
}

pvx_err rec_sysmat_footprints(const rec_sysmat *m, const struct rec_camera *c,
                              const struct rec_sysmat_block *b, const struct rec_sysmat_part *part,
                              pvx_pool *pool, struct rec_rect *fp)
{
    int32_t span = m->grid.basis == REC_TRILINEAR ? 2 : 1;
    struct job j = {.m = m,
                    .c = c,
                    .b = b,
                    .part = part,
                    .fp = fp,
                    .span = span,
                    .nx = m->grid.n[0] + span,
                    .ny = m->grid.n[1] + span};
    pvx_pool_run(pool, (size_t)(m->grid.n[2] + SLAB - 1) / SLAB, slab, &j);
    return atomic_load(&j.out_of_memory) ? PVX_ENOMEM : PVX_OK;
}
