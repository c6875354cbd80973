#include "recon/matrix/rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/geom/traverse.h"

void rec_tracer_init(struct rec_tracer *t, const struct rec_rig *rig,
                     const struct rec_sysmat_params *p)
{
    *t = (struct rec_tracer){.rig = rig, .binning = p->binning, .rays = p->rays_per_bin};
    t->per_unit = 1.0 / rec_sysmat_unit(&rig->grid);
    t->most = t->rays * t->rays;
    for (size_t c = 0; c < rig->n_cameras; c++) {
        rec_bundle_init(&t->bundle, &rig->cameras[c], t->binning, t->rays, &rig->grid);
        int32_t n = rec_bundle_rays(&t->bundle);
        t->most = n > t->most ? n : t->most;
    }
    t->bin_max = rec_traverse_max(&rig->grid) * (size_t)t->most;
    if (t->most > t->rays * t->rays && t->bin_max > rec_grid_count(&rig->grid))
        t->bin_max = rec_grid_count(&rig->grid) + 1; /* a voxel is in a bin once */
}

void rec_tracer_camera(struct rec_tracer *t, size_t c, int32_t bw)
{
    rec_bundle_init(&t->bundle, &t->rig->cameras[c], t->binning, t->rays, &t->rig->grid);
    t->bw = bw;
}

pvx_err rec_rays_new(const struct rec_tracer *t, struct rec_rays *r)
{
    size_t max = rec_traverse_max(&t->rig->grid);
    *r = (struct rec_rays){.slot_bits = 4};
    while ((size_t)1 << r->slot_bits < 2 * t->bin_max)
        r->slot_bits++;
    r->index = pvx_calloc(max, sizeof *r->index);
    r->value = pvx_calloc(max, sizeof *r->value);
    bool ok = r->index != NULL && r->value != NULL;
    if (t->most > 1) {
        r->slot = pvx_calloc((size_t)1 << r->slot_bits, sizeof *r->slot);
        r->order = pvx_calloc(t->bin_max, sizeof *r->order);
        ok = ok && r->slot != NULL && r->order != NULL;
    }
    if (!ok)
        rec_rays_free(r);
    return ok ? PVX_OK : PVX_ENOMEM;
}

void rec_rays_free(struct rec_rays *r)
{
    free(r->index);
    free(r->value);
    free(r->slot);
    free(r->order);
    *r = (struct rec_rays){0};
}

/* A ray of bin (x,y).  False: the lens does not reach there, it sees nothing. */
static bool ray_of(const struct rec_tracer *t, int32_t x, int32_t y, int32_t sub, double o[3],
                   double d[3])
{
    double u = (double)x * t->binning - 0.5, v = (double)y * t->binning - 0.5;
    return rec_bundle_ray(&t->bundle, u, v, sub, o, d);
}

/* Metres to the first body, also into the bin's depth. */
static double end_of(const struct rec_tracer *t, int32_t x, int32_t y, const double o[3],
                     const double d[3])
{
    double end = INFINITY;
    if (t->depth != NULL) {
        end = rec_body_hit(&t->rig->bodies, o, d);
        float *bin = &t->depth[(size_t)y * (size_t)t->bw + (size_t)x];
        *bin = end < *bin ? (float)end : *bin;
    }
    return end;
}

/* Entries of a sub-ray in r->index, r->value. */
static size_t rays_trace(const struct rec_tracer *t, struct rec_rays *r, int32_t x, int32_t y,
                         int32_t sub)
{
    double o[3], d[3];
    if (!ray_of(t, x, y, sub, o, d))
        return 0;
    return rec_traverse_until(&t->rig->grid, o, d, end_of(t, x, y, o, d), r->index, r->value);
}

/* Add a ray to the bin's table; `used` slots so far. */
static size_t merge(struct rec_rays *r, size_t n, size_t used)
{
    uint32_t mask = (1u << r->slot_bits) - 1;
    for (size_t i = 0; i < n; i++) {
        uint32_t h = (uint32_t)r->index[i] * 2654435769u >> (32 - r->slot_bits);
        while (r->slot[h].epoch == r->epoch && r->slot[h].index != r->index[i])
            h = (h + 1) & mask;
        struct rec_ray_slot *slot = &r->slot[h];
        if (slot->epoch != r->epoch) {
            *slot = (struct rec_ray_slot){r->index[i], r->epoch, 0};
            r->order[used++] = h;
        }
        slot->sum += r->value[i];
    }
    return used;
}

/* The running sum of a row, rounded: sysmat.h (3). */
struct row {
    double sum; /* in units, and 1/2 */
    int64_t done;
    uint32_t *col;
    uint8_t *val;
    size_t n;
};

static inline void rays_put(struct row *r, int32_t index, double units)
{
    r->sum += units;
    int64_t now = (int64_t)r->sum, q = now - r->done;
    q = q < UINT8_MAX ? q : UINT8_MAX;
    r->done += q;
    r->col[r->n] = (uint32_t)index;
    r->val[r->n] = (uint8_t)q;
    r->n += q > 0;
}

size_t rec_rays_bin(const struct rec_tracer *t, struct rec_rays *r, int32_t x, int32_t y,
                    uint32_t *col, uint8_t *val)
{
    struct row row = {.sum = 0.5, .col = col, .val = val};
    int32_t rays = rec_bundle_rays(&t->bundle);
    if (rays == 1) {
        size_t traced = rays_trace(t, r, x, y, 0);
        for (size_t i = 0; i < traced; i++)
            rays_put(&row, r->index[i], r->value[i] * t->per_unit);
        return row.n;
    }
    size_t used = 0;
    if (++r->epoch == 0) {
        memset(r->slot, 0, sizeof *r->slot << r->slot_bits);
        r->epoch = 1;
    }
    for (int32_t sub = 0; sub < rays; sub++)
        used = merge(r, rays_trace(t, r, x, y, sub), used);
    double share = t->per_unit / rays;
    for (size_t i = 0; i < used; i++) {
        const struct rec_ray_slot *slot = &r->slot[r->order[i]];
        rays_put(&row, slot->index, slot->sum * share);
    }
    return row.n;
}

static void depth_row(void *ctx, size_t y)
{
    const struct rec_tracer *t = ctx;
    double o[3], d[3];
    for (int32_t x = 0; x < t->bw; x++)
        for (int32_t sub = 0; sub < rec_bundle_rays(&t->bundle); sub++)
            if (ray_of(t, x, (int32_t)y, sub, o, d))
                (void)end_of(t, x, (int32_t)y, o, d);
}

void rec_rays_depth(const struct rec_tracer *t, int32_t bh, pvx_pool *pool)
{
    struct rec_tracer copy = *t;
    if (t->depth != NULL)
        pvx_pool_run(pool, (size_t)bh, depth_row, &copy);
}

bool rec_rays_new_depth(const struct rec_rig *rig, size_t rows, float **out)
{
    *out = NULL;
    if (rig->bodies.n == 0)
        return true;
    *out = rec_sysmat_array(rows * sizeof **out);
    for (size_t i = 0; *out != NULL && i < rows; i++)
        (*out)[i] = INFINITY;
    return *out != NULL;
}
