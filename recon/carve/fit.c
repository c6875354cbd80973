#include "recon/carve/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

struct rec_fit {
    struct rec_rig rig; /* the coarse grid; a camera's pixel is a pooled bin */
    rec_sysmat *S;
    rec_hull *hull;
    pvx_pool *pool;
    struct rec_hull_params params;
    struct camera {
        int32_t sw, sh, pool; /* size of the silhouette; its bins per side of a pooled bin */
        uint8_t *lit;
    } camera[REC_MAX_CAMERAS];
    int32_t *col; /* [cells] */
    struct extent {
        int32_t lo[3], hi[3];      /* cells of the union so far */
        uint32_t lit;              /* sets with a hull */
    } extent[REC_MAX_CAMERAS + 1]; /* by number of views */
    uint32_t sets;
};

/* Raw pixels across one coarse cell in the middle of the volume; 0 if that is not in front of the camera. */
static double cell_px(const struct rec_grid *g, const struct rec_camera *c)
{
    double X[3], h = INFINITY;
    for (int a = 0; a < 3; a++) {
        X[a] = 0.5 * (g->min[a] + g->max[a]);
        h = fmin(h, rec_grid_h(g, a));
    }
    double z = rec_camera_depth(c, X);
    return z > 0 ? fmin(c->fx, c->fy) * h / z : 0;
}

/* Pool bins to at most half a cell, but leave an image at least 32 of them. */
static int32_t pooling(const struct rec_grid *g, const struct rec_camera *c, int32_t binning)
{
    double most = fmin(c->width, c->height) / (32.0 * binning);
    double k = fmin(0.5 * cell_px(g, c) / binning, most);
    return k >= 1 ? (int32_t)k : 1;
}

static void fit_pool_camera(rec_fit *f, size_t i, int32_t binning)
{
    struct rec_camera *c = &f->rig.cameras[i];
    struct camera *v = &f->camera[i];
    v->sw = (c->width + binning - 1) / binning;
    v->sh = (c->height + binning - 1) / binning;
    v->pool = pooling(&f->rig.grid, c, binning);
    double b = (double)v->pool * binning; /* raw pixels per side of a pooled bin */
    c->fx /= b;
    c->fy /= b;
    c->blur.sigma /= b;
    c->cx = (c->cx + 0.5) / b - 0.5;
    c->cy = (c->cy + 0.5) / b - 0.5;
    c->width = (v->sw + v->pool - 1) / v->pool;
    c->height = (v->sh + v->pool - 1) / v->pool;
}

static pvx_err fit_set_up(rec_fit *f, const struct rec_rig *rig, const struct rec_fit_params *p,
                          struct pvx_diag *d)
{
    PVX_TRY(rec_rig_copy(rig, &f->rig));
    struct rec_grid *g = &f->rig.grid;
    double side = 0;
    g->basis = REC_BOX; /* its supports fill the volume without overlap */
    for (int a = 0; a < 3; a++)
        side = fmax(side, g->max[a] - g->min[a]);
    for (int a = 0; a < 3; a++)
        g->n[a] = (int32_t)fmax(1, lrint(p->cells * (g->max[a] - g->min[a]) / side));
    for (size_t c = 0; c < rig->n_cameras; c++) {
        fit_pool_camera(f, c, p->binning);
        f->camera[c].lit =
            pvx_calloc((size_t)f->rig.cameras[c].width * (size_t)f->rig.cameras[c].height, 1);
        if (f->camera[c].lit == NULL)
            return PVX_ENOMEM;
    }
    f->col = pvx_calloc(rec_grid_count(g), sizeof *f->col);
    if (f->col == NULL)
        return PVX_ENOMEM;
    struct rec_sysmat_params one = {.binning = 1, .rays_per_bin = 1};
    PVX_TRY(rec_sysmat_build(&f->rig, &one, f->pool, NULL, NULL, &f->S, d));
    return rec_hull_new(f->S, &f->hull);
}

pvx_err rec_fit_new(const struct rec_rig *rig, const struct rec_fit_params *p, pvx_pool *pool,
                    rec_fit **out, struct pvx_diag *d)
{
    *out = NULL;
    if (p->cells < 4 || p->cells > 256 || p->binning < 1 || rig->n_cameras < 1 ||
        p->min_views > rig->n_cameras)
        return pvx_fail(d, PVX_EINVAL,
                        "fit: 4 to 256 cells, binning from 1, no more views than cameras");
    rec_fit *f = pvx_calloc(1, sizeof *f);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "fit: out of memory");
    f->pool = pool;
    f->params = (struct rec_hull_params)REC_HULL_DEFAULTS;
    f->params.min_views = p->min_views;
    for (int m = 0; m <= REC_MAX_CAMERAS; m++)
        for (int a = 0; a < 3; a++) {
            f->extent[m].lo[a] = INT32_MAX;
            f->extent[m].hi[a] = -1;
        }
    pvx_err e = fit_set_up(f, rig, p, d);
    if (e != PVX_OK) {
        rec_fit_free(&f);
        return pvx_fail(d, e, "fit: coarse hull: %s", pvx_strerror(e));
    }
    *out = f;
    return PVX_OK;
}

void rec_fit_free(rec_fit **fp)
{
    rec_fit *f = *fp;
    if (f == NULL)
        return;
    rec_hull_free(&f->hull);
    rec_sysmat_free(&f->S);
    for (size_t c = 0; c < f->rig.n_cameras; c++)
        free(f->camera[c].lit);
    free(f->col);
    rec_rig_fini(&f->rig);
    free(f);
    *fp = NULL;
}

struct adding {
    rec_fit *f;
    const uint8_t *const *lit;
    const bool *present;
};

/* Pooled silhouette of one camera.  Bins that reach over the image's edge hold less information, but the hull never
 * carves at an edge. */
static void pool_silhouette(void *ctx, size_t i)
{
    const struct adding *t = ctx;
    const struct camera *v = &t->f->camera[i];
    const struct rec_camera *c = &t->f->rig.cameras[i];
    size_t w = (size_t)c->width;
    if (!t->present[i])
        return;
    memset(v->lit, 0, w * (size_t)c->height);
    for (int32_t y = 0; y < v->sh; y++) {
        const uint8_t *in = t->lit[i] + (size_t)y * (size_t)v->sw;
        uint8_t *out = v->lit + (size_t)(y / v->pool) * w;
        for (int32_t x = 0; x < v->sw; x++)
            if (in[x] != 0)
                out[x / v->pool] = 1;
    }
}

static void add_cells(struct extent *e, const struct rec_grid *g, const int32_t *col, int32_t n)
{
    for (int32_t q = 0; q < n; q++) {
        int32_t v[3];
        rec_grid_ijk(g, col[q], v);
        for (int a = 0; a < 3; a++) {
            e->lo[a] = v[a] < e->lo[a] ? v[a] : e->lo[a];
            e->hi[a] = v[a] > e->hi[a] ? v[a] : e->hi[a];
        }
    }
    e->lit++;
}

int32_t rec_fit_add(rec_fit *f, const uint8_t *const *lit, const bool *present)
{
    struct adding t = {f, lit, present};
    const uint8_t *pooled[REC_MAX_CAMERAS];
    pvx_pool_run(f->pool, f->rig.n_cameras, pool_silhouette, &t);
    for (size_t c = 0; c < f->rig.n_cameras; c++)
        pooled[c] = f->camera[c].lit;
    int32_t kept = 0;
    for (uint32_t m = f->params.min_views; m <= f->rig.n_cameras; m++) {
        struct rec_hull_params p = f->params;
        struct rec_hull_kept k = {.col = f->col};
        p.min_views = m;
        rec_hull_carve(f->hull, &p, pooled, present, f->pool, &k);
        if (k.n == 0)
            break; /* no hull with more views either */
        add_cells(&f->extent[m], &f->rig.grid, f->col, k.n);
        kept = m == f->params.min_views ? k.n : kept;
    }
    f->sets++;
    return kept;
}

pvx_err rec_fit_get(const rec_fit *f, uint32_t views, double margin, struct rec_fit_box *out)
{
    const struct rec_grid *g = &f->rig.grid;
    uint32_t m = views == 0 ? f->params.min_views : views;
    *out = (struct rec_fit_box){.sets = f->sets};
    if (m < f->params.min_views || m > f->rig.n_cameras)
        return PVX_EINVAL;
    const struct extent *e = &f->extent[m];
    out->lit = e->lit;
    if (e->lit == 0)
        return PVX_ENOENT;
    for (int a = 0; a < 3; a++) {
        double h = rec_grid_h(g, a), by = margin < 0 ? h : margin;
        out->cell = fmax(out->cell, h);
        out->min[a] = fmax(g->min[a], g->min[a] + e->lo[a] * h - by);
        out->max[a] = fmin(g->max[a], g->min[a] + (e->hi[a] + 1) * h + by);
        out->touches |= (e->lo[a] == 0 ? 1u : 0u) << 2 * a;
        out->touches |= (e->hi[a] == g->n[a] - 1 ? 2u : 0u) << 2 * a;
    }
    return PVX_OK;
}

/* Number of voxels of size h that hold the interval [lo,hi]; an excess at rounding adds no voxel. */
static int32_t voxels(double lo, double hi, double h)
{
    return (int32_t)fmin(REC_GRID_MAX + 1, fmax(1, ceil((hi - lo) / h - 1e-6)));
}

pvx_err rec_fit_grid(const struct rec_grid *rig, const struct rec_fit_box *box, const int32_t n[3],
                     struct rec_grid *out)
{
    double side = 0;
    for (int a = 0; a < 3; a++)
        side = fmax(side, box->max[a] - box->min[a]);
    out->basis = rig->basis;
    for (int a = 0; a < 3; a++) {
        double lo = box->min[a], hi = box->max[a], h = rec_grid_h(rig, a);
        if (n[0] == 0) {
            lo = rig->min[a] + h * floor((lo - rig->min[a]) / h + 1e-6);
            out->n[a] = voxels(lo, hi, h);
            hi = lo + h * out->n[a];
        } else if (n[1] == 0) {
            h = side / n[0];
            out->n[a] = voxels(lo, hi, h);
            double grow = (h * out->n[a] - (hi - lo)) / 2;
            lo -= grow;
            hi += grow;
        } else {
            out->n[a] = n[a];
        }
        if (out->n[a] < 1 || out->n[a] > REC_GRID_MAX)
            return PVX_ERANGE;
        out->min[a] = lo;
        out->max[a] = hi;
    }
    return PVX_OK;
}
