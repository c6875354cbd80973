/* Footprints: where the support of each basis function can appear in a camera's image.
 *
 * The support is a box whose corners are planes of one lattice, so the lattice is projected once and
 * every box looks up its eight corners.  A pinhole maps the box into the hull of its corners; a lens
 * bends that hull's edges.  For f with second derivatives up to M, a point inside a polygon of
 * diameter D has f <= max over the corners + M D^2/4 (interpolate along a chord to two edge points,
 * then along the edges); M D is bounded by the change of the Jacobian over the corners, times 2 for
 * changes that the corners do not show.  Behind windows straight lines bend a
 * little (rec_glass_bend).  Where no pinhole stands behind the map, and where some of the volume is not seen through the
 * glass, the Jacobian is that by the point's own coordinates, and D is the diagonal of the box. */
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/geom/bundle.h"
#include "recon/geom/glass.h"
#include "recon/matrix/footprint.h"

#define SLAB 8 /* layers of voxels per task, at least */

struct job {
    const rec_sysmat *m;
    const struct rec_camera *c;
    const struct rec_sysmat_block *b;
    const struct rec_entries *part; /* colptr NULL: entries are not known */
    struct rec_rect *fp;            /* output: of all voxels, or: */
    struct rec_rect *brick;         /* of bricks; both NULL: of the kept voxels on all levels */
    const _Atomic uint64_t *met;    /* [N bits] columns that have entries of camera */
    size_t camera;
    int32_t n[3];    /* items */
    int32_t slab;    /* layers of items per task */
    int32_t stride;  /* lattice points from an item's first to the next one's */
    int32_t span;    /* lattice points from an item's first to its last one */
    int32_t nx, ny;  /* lattice points per layer */
    double per_bin;  /* 1 / binning */
    bool by_point;   /* the quantities from X on are d(u,v)/dX_cam */
    double diagonal; /* m, of a support */
    double bend;     /* px, of any support: rounding, and the glass */
    bool blurred;
    atomic_bool out_of_memory;
};

/* Quantities of a projected point: pixel, normalised undistorted coordinates, Jacobian. */
enum { U, V, X, Y, J0, J1, J2, J3, QUANTITIES };

/* A layer of lattice points, quantity after quantity, so that loops over a row of them are vectors. */
struct layer {
    double *q[QUANTITIES]; /* [ny*nx] */
    uint8_t *hidden;       /* [ny*nx] behind the camera or past the fold of its lens */
};

/* Least and largest of the corners of the supports that start in one row of the lattice. */
struct corners {
    double *lo[QUANTITIES], *hi[QUANTITIES]; /* [nx] */
    uint8_t *hidden;                         /* [nx] any of them */
};

static const struct rec_rect unseen = {1, 1, 0, 0};

void rec_no_footprints(const rec_sysmat *m, struct rec_rect *fp)
{
    for (size_t i = 0; i < rec_brick_places(&m->grid); i++)
        fp[i] = unseen;
}

/* Lattice plane i along an axis: the faces of the cells, or for trilinear the centres with one more at either end.
 * Bricks have two planes each, because their supports overlap: the beginning of their first voxel's and the end of
 * their last one's. */
static double plane(const struct job *j, int a, int32_t i)
{
    const struct rec_grid *g = &j->m->grid;
    bool trilinear = g->basis == REC_TRILINEAR;
    if (j->brick != NULL) {
        int32_t end = (i / 2 + 1) * REC_BRICK;
        i = i % 2 == 0 ? i / 2 * REC_BRICK : (end < g->n[a] ? end : g->n[a]) + trilinear;
    }
    return g->min[a] + (trilinear ? i - 0.5 : i) * rec_grid_h(g, a);
}

static void project_layer(const struct job *j, int32_t k, struct layer *l)
{
    for (int32_t y = 0; y < j->ny; y++)
        for (int32_t x = 0; x < j->nx; x++) {
            size_t at = (size_t)y * (size_t)j->nx + (size_t)x;
            double point[3] = {plane(j, 0, x), plane(j, 1, y), plane(j, 2, k)};
            struct rec_projection p;
            double D[6];
            l->hidden[at] = j->by_point ? !rec_camera_slopes(j->c, point, &p, D)
                                        : !rec_camera_project_full(j->c, point, &p);
            if (l->hidden[at])
                continue;
            double all[QUANTITIES] = {p.u, p.v, p.x, p.y, p.J[0], p.J[1], p.J[2], p.J[3]};
            if (j->by_point)
                memcpy(all + X, D, sizeof D);
            for (int q = 0; q < QUANTITIES; q++)
                l->q[q][at] = all[q];
        }
}

static inline double footprint_least(double a, double b)
{
    return a < b ? a : b;
}
static inline double most(double a, double b)
{
    return a > b ? a : b;
}

/* Minimum and maximum over the four lattice rows of the supports of item row y between two layers, then along the
 * rows. */
static void gather_corners(const struct job *j, const struct layer *near, const struct layer *far,
                           int32_t y, struct corners *out)
{
    size_t n = (size_t)j->nx, a = (size_t)(y * j->stride) * n, b = a + (size_t)j->span * n;
    size_t span = (size_t)j->span;
    for (int q = 0; q < QUANTITIES; q++) {
        const double *na = near->q[q] + a, *nb = near->q[q] + b;
        const double *fa = far->q[q] + a, *fb = far->q[q] + b;
        double *restrict lo = out->lo[q], *restrict hi = out->hi[q];
        for (size_t x = 0; x < n; x++) {
            lo[x] = footprint_least(footprint_least(na[x], nb[x]), footprint_least(fa[x], fb[x]));
            hi[x] = most(most(na[x], nb[x]), most(fa[x], fb[x]));
        }
        for (size_t x = 0; x + span < n; x++) {
            lo[x] = footprint_least(lo[x], lo[x + span]);
            hi[x] = most(hi[x], hi[x + span]);
        }
    }
    for (size_t x = 0; x < n; x++)
        out->hidden[x] =
            near->hidden[a + x] | near->hidden[b + x] | far->hidden[a + x] | far->hidden[b + x];
    for (size_t x = 0; x + span < n; x++)
        out->hidden[x] |= out->hidden[x + span];
}

/* Bins of the pixel range [lo,hi], clipped to `n` bins; false when it lies outside, *cut when some of it does. */
static bool footprint_bins(double lo, double hi, double per_bin, int32_t n, uint16_t *first,
                           uint16_t *last, bool *cut)
{
    double a = (lo + 0.5) * per_bin, b = (hi + 0.5) * per_bin;
    if (!(b >= 0) || !(a < n))
        return false;
    *cut = *cut || a < 0 || !(b < n);
    *first = (uint16_t)(a < 0 ? 0 : a);
    *last = (uint16_t)(b > n - 1 ? n - 1 : b);
    return true;
}

/* All corners are in front of the camera: the rectangle of the support, grown for the lens.  If a brick reaches
 * beyond the image, some of its voxels may be unseen. */
static struct rec_rect rectangle(const struct job *j, const struct corners *k, size_t x)
{
    double range[QUANTITIES];
    for (int q = 0; q < QUANTITIES; q++)
        range[q] = k->hi[q][x] - k->lo[q][x];
    double D = sqrt(range[X] * range[X] + range[Y] * range[Y]);
    double bend_u = 0.5 * D * (range[J0] + range[J1]) + j->bend;
    double bend_v = 0.5 * D * (range[J2] + range[J3]) + j->bend;
    if (j->by_point) {
        bend_u = 0.5 * j->diagonal * (range[X] + range[X + 1] + range[X + 2]) + j->bend;
        bend_v = 0.5 * j->diagonal * (range[X + 3] + range[X + 4] + range[X + 5]) + j->bend;
    }
    struct rec_rect r;
    bool cut = false;
    if (!footprint_bins(k->lo[U][x] - bend_u, k->hi[U][x] + bend_u, j->per_bin, j->b->bw, &r.x0,
                        &r.x1, &cut) ||
        !footprint_bins(k->lo[V][x] - bend_v, k->hi[V][x] + bend_v, j->per_bin, j->b->bh, &r.y0,
                        &r.y1, &cut))
        return unseen;
    return j->brick != NULL && cut ? REC_RECT_UNKNOWN : r;
}

/* Extends the rectangle to the rows of column `col`: it contains them by construction then. */
static struct rec_rect with_entries(const struct job *j, size_t col, struct rec_rect r)
{
    const struct rec_active *a = j->m->active;
    if (a != NULL && !rec_active_has(a, col))
        return r;
    size_t at = a != NULL ? rec_active_rank(a, col) : col;
    uint32_t e0 = j->part->colptr[at], e1 = j->part->colptr[at + 1];
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

/* Whether a body may be nearer to the camera than some of the support, in a bin of the rectangle or beside it (between
 * its rays the outline of a body is not known). */
static bool behind_body(const struct job *j, const int32_t item[3], struct rec_rect r)
{
    double centre[3], d2 = 0, half2 = 0;
    if (j->part->depth == NULL || !rec_rect_seen(r))
        return false;
    rec_camera_centre(j->c, centre);
    for (int a = 0; a < 3; a++) {
        double lo = plane(j, a, item[a] * j->stride),
               hi = plane(j, a, item[a] * j->stride + j->span);
        double d = 0.5 * (lo + hi) - centre[a], half = 0.5 * (hi - lo);
        d2 += d * d;
        half2 += half * half;
    }
    double far = (sqrt(d2) + sqrt(half2)) * (1 + 1e-6); /* depth is a float */
    int32_t x0 = r.x0 > 0 ? r.x0 - 1 : 0, x1 = r.x1 + 1 < j->b->bw ? r.x1 + 1 : r.x1;
    int32_t y0 = r.y0 > 0 ? r.y0 - 1 : 0, y1 = r.y1 + 1 < j->b->bh ? r.y1 + 1 : r.y1;
    for (int32_t y = y0; y <= y1; y++)
        for (int32_t x = x0; x <= x1; x++)
            if (j->part->depth[(size_t)y * (size_t)j->b->bw + (size_t)x] < far)
                return true;
    return false;
}

static size_t footprint_column(const struct job *j, const int32_t voxel[3])
{
    return (size_t)rec_grid_index(&j->m->grid, voxel[0], voxel[1], voxel[2]);
}

static bool has_entries(const struct job *j, size_t col)
{
    if (j->met != NULL)
        return (atomic_load_explicit(&j->met[col / 64], memory_order_relaxed) >> col % 64 & 1) != 0;
    return j->part->colptr[col] != j->part->colptr[col + 1];
}

static struct rec_rect footprint(const struct job *j, const int32_t item[3],
                                 const struct corners *k)
{
    size_t x = (size_t)(item[0] * j->stride);
    if (!k->hidden[x]) {
        struct rec_rect r = rectangle(j, k, x);
        if (!behind_body(j, item, r))
            return j->part->colptr != NULL && !j->blurred
                       ? with_entries(j, footprint_column(j, item), r)
                       : r;
    }
    /* partly behind a body or the camera or past the fold of the lens: its outline is not known */
    if (j->part->colptr == NULL)
        return REC_RECT_UNKNOWN;
    if (!has_entries(j, footprint_column(j, item)))
        return unseen;
    return (struct rec_rect){0, 0, (uint16_t)(j->b->bw - 1), (uint16_t)(j->b->bh - 1)};
}

/* Extends u by r. */
static void footprint_widen(struct rec_rect *u, struct rec_rect r)
{
    if (!rec_rect_seen(r))
        return;
    if (!rec_rect_seen(*u)) {
        *u = r;
        return;
    }
    u->x0 = r.x0 < u->x0 ? r.x0 : u->x0;
    u->y0 = r.y0 < u->y0 ? r.y0 : u->y0;
    u->x1 = r.x1 > u->x1 ? r.x1 : u->x1;
    u->y1 = r.y1 > u->y1 ? r.y1 : u->y1;
}

/* Extends the footprint of the voxel on every level that keeps it.  Only this task writes to these voxels. */
static void to_levels(const struct job *j, const int32_t voxel[3], struct rec_rect r)
{
    int32_t x = voxel[0], y = voxel[1], k = voxel[2];
    for (const rec_sysmat *m = j->m; m != NULL; m = m->coarse, x /= 2, y /= 2, k /= 2) {
        size_t place = rec_brick_place(&m->grid, x, y, k);
        if (m->active == NULL || m->active->brick[place / REC_BRICK_VOXELS])
            footprint_widen((struct rec_rect *)&m->block[j->camera].fp[place], r);
        if (rec_rect_seen(r))
            r = (struct rec_rect){r.x0 / 2, r.y0 / 2, r.x1 / 2, r.y1 / 2};
    }
}

static void footprint_put(const struct job *j, const int32_t item[3], struct rec_rect r)
{
    const struct rec_grid *g = &j->m->grid;
    if (j->brick != NULL)
        j->brick[rec_brick_place(g, item[0] * REC_BRICK, item[1] * REC_BRICK, item[2] * REC_BRICK) /
                 REC_BRICK_VOXELS] = r;
    else if (j->fp != NULL)
        j->fp[rec_brick_place(g, item[0], item[1], item[2])] = r;
    else
        to_levels(j, item, r);
}

/* The layers of a slab and one row of corners, in one piece of memory. */
struct work {
    struct layer ring[3];
    struct corners corners;
    void *memory;
};

static bool new_work(const struct job *j, struct work *w)
{
    size_t nx = (size_t)j->nx, layer = nx * (size_t)j->ny;
    size_t doubles = QUANTITIES * (3 * layer + 2 * nx);
    double *p = w->memory = pvx_calloc(doubles * sizeof *p + 3 * layer + nx, 1);
    if (p == NULL)
        return false;
    for (int q = 0; q < QUANTITIES; q++) {
        for (int i = 0; i < 3; i++, p += layer)
            w->ring[i].q[q] = p;
        w->corners.lo[q] = p;
        w->corners.hi[q] = p + nx;
        p += 2 * nx;
    }
    uint8_t *hidden = (uint8_t *)p;
    for (int i = 0; i < 3; i++, hidden += layer)
        w->ring[i].hidden = hidden;
    w->corners.hidden = hidden;
    return true;
}

static void footprint_slab(void *ctx, size_t task)
{
    struct job *j = ctx;
    int32_t planes = j->span + 1, k0 = (int32_t)task * j->slab;
    int32_t k1 = k0 + j->slab < j->n[2] ? k0 + j->slab : j->n[2], next = k0 * j->stride;
    struct work w;
    if (!new_work(j, &w)) {
        atomic_store(&j->out_of_memory, true);
        return;
    }
    for (int32_t k = k0; k < k1; k++) {
        int32_t near = k * j->stride, far = near + j->span;
        for (; next <= far; next++)
            project_layer(j, next, &w.ring[next % planes]);
        for (int32_t y = 0; y < j->n[1]; y++) {
            gather_corners(j, &w.ring[near % planes], &w.ring[far % planes], y, &w.corners);
            for (int32_t x = 0; x < j->n[0]; x++) {
                int32_t item[3] = {x, y, k};
                footprint_put(j, item, footprint(j, item, &w.corners));
            }
        }
    }
    free(w.memory);
}

static pvx_err footprint_project(struct job *j, pvx_pool *pool)
{
    const struct rec_grid *g = &j->m->grid;
    bool bricks = j->brick != NULL;
    j->stride = bricks ? 2 : 1;
    j->span = bricks || g->basis != REC_TRILINEAR ? 1 : 2;
    for (int a = 0; a < 3; a++)
        j->n[a] = bricks ? rec_bricks(g, a) : g->n[a];
    j->nx = (j->n[0] - 1) * j->stride + j->span + 1;
    j->ny = (j->n[1] - 1) * j->stride + j->span + 1;
    j->per_bin = 1.0 / j->m->binning;
    for (int a = 0; a < 3; a++) {
        double side = (bricks ? REC_BRICK + 1 : j->span) * rec_grid_h(g, a);
        j->diagonal = hypot(j->diagonal, side);
    }
    double glass =
        j->c->n_windows > 0 && j->c->model != REC_TELECENTRIC ? rec_glass_bend(j->c, g) : 0;
    struct rec_bundle bundle;
    rec_bundle_init(&bundle, j->c, j->m->binning, j->m->rays_per_bin, g);
    j->by_point = j->c->model >= REC_TELECENTRIC || glass < 0;
    j->blurred = bundle.reach > 0;
    j->bend = (j->c->model == REC_RAYS ? 0.05 : 1e-6) + /* the slopes of rays are steps */
              fmax(glass, 0) * j->diagonal * j->diagonal / 4;
    pvx_pool_run(pool, (size_t)((j->n[2] + j->slab - 1) / j->slab), footprint_slab, j);
    return atomic_load(&j->out_of_memory) ? PVX_ENOMEM : PVX_OK;
}

pvx_err rec_sysmat_footprints(const rec_sysmat *m, const struct rec_camera *c,
                              const struct rec_sysmat_block *b, const struct rec_entries *part,
                              pvx_pool *pool, struct rec_rect *fp)
{
    struct job j = {.m = m, .c = c, .b = b, .part = part, .fp = fp, .slab = SLAB};
    rec_no_footprints(m, fp);
    return footprint_project(&j, pool);
}

pvx_err rec_sysmat_brick_footprints(const rec_sysmat *m, const struct rec_camera *c,
                                    const struct rec_sysmat_block *b, float *depth, pvx_pool *pool,
                                    struct rec_rect *brick)
{
    const struct rec_entries none = {.depth = depth};
    struct job j = {
        .m = m, .c = c, .b = b, .part = &none, .brick = brick, .slab = SLAB / REC_BRICK};
    return footprint_project(&j, pool);
}

pvx_err rec_sysmat_active_footprints(const rec_sysmat *m, size_t c, const struct rec_camera *camera,
                                     const struct rec_entries *part, const _Atomic uint64_t *met,
                                     pvx_pool *pool)
{
    struct job j = {
        .m = m, .c = camera, .b = &m->block[c], .part = part, .met = met, .camera = c, .slab = 1};
    for (const rec_sysmat *l = m; l != NULL; l = l->coarse) {
        struct rec_rect *fp = (struct rec_rect *)l->block[c].fp;
        for (size_t i = 0; i < rec_brick_places(&l->grid); i++)
            if (l->active == NULL || l->active->brick[i / REC_BRICK_VOXELS])
                fp[i] = unseen;
        j.slab *= l->coarse != NULL ? 2 : 1;
    }
    j.slab = j.slab > SLAB ? j.slab : SLAB;
    return footprint_project(&j, pool);
}
