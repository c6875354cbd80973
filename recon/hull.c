#include "recon/carve/hull.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define BRICK 4

const struct rec_hull_params rec_hull_defaults = REC_HULL_DEFAULTS;

/* Bricks are BRICK^3 voxels, x fastest.  A slab is one layer of bricks along z: the unit of parallel
 * work, and because voxel order is z-major the slabs' results only have to be put end to end. */
struct rec_hull {
    const rec_sysmat *S;
    int32_t nb[3];
    struct rec_rect *brick[REC_MAX_CAMERAS]; /* [bricks]: union of members' footprints, "unseen"
                                                where a member is unseen: such a camera can not
                                                drop the brick as a whole */
    uint32_t *sat[REC_MAX_CAMERAS];      /* [(bh+1)*(bw+1)] lit bins above and left of a corner */
    uint8_t *keep;                       /* [bricks] */
    int32_t *col;                        /* [N] kept voxels of each slab, from the slab's start */
    uint8_t *klass;                      /* [N] their class, 1 or 2 */
    int32_t *slab_n;                     /* [nb z] */
    struct rec_hull_counts *slab_counts; /* [nb z] */
};

static struct rec_rect brick_rect(const rec_sysmat *S, size_t c, const int32_t b[3])
{
    const struct rec_grid *g = &S->grid;
    struct rec_rect u = {.x0 = UINT16_MAX, .y0 = UINT16_MAX, .x1 = 0, .y1 = 0};
    const struct rec_rect unseen = {.x0 = 1, .y0 = 1, .x1 = 0, .y1 = 0};
    for (int32_t k = b[2] * BRICK; k < (b[2] + 1) * BRICK && k < g->n[2]; k++)
        for (int32_t j = b[1] * BRICK; j < (b[1] + 1) * BRICK && j < g->n[1]; j++)
            for (int32_t i = b[0] * BRICK; i < (b[0] + 1) * BRICK && i < g->n[0]; i++) {
                struct rec_rect r = S->block[c].fp[rec_grid_index(g, i, j, k)];
                if (!rec_rect_seen(r))
                    return unseen;
                u.x0 = r.x0 < u.x0 ? r.x0 : u.x0;
                u.y0 = r.y0 < u.y0 ? r.y0 : u.y0;
                u.x1 = r.x1 > u.x1 ? r.x1 : u.x1;
                u.y1 = r.y1 > u.y1 ? r.y1 : u.y1;
            }
    return u;
}

pvx_err rec_hull_new(const rec_sysmat *S, rec_hull **out)
{
    *out = NULL;
    rec_hull *h = pvx_calloc(1, sizeof *h);
    if (h == NULL)
        return PVX_ENOMEM;
    h->S = S;
    for (int a = 0; a < 3; a++)
        h->nb[a] = (S->grid.n[a] + BRICK - 1) / BRICK;
    size_t bricks = (size_t)h->nb[0] * (size_t)h->nb[1] * (size_t)h->nb[2];
    size_t n = rec_grid_count(&S->grid);
    h->keep = pvx_calloc(bricks, 1);
    h->slab_n = pvx_calloc((size_t)h->nb[2], sizeof *h->slab_n);
    h->slab_counts = pvx_calloc((size_t)h->nb[2], sizeof *h->slab_counts);
    h->col = pvx_reserve(n * sizeof *h->col);
    h->klass = pvx_reserve(n);
    bool ok = h->keep != NULL && h->slab_n != NULL && h->slab_counts != NULL && h->col != NULL &&
              h->klass != NULL;
    for (size_t c = 0; ok && c < S->n_cameras; c++) {
        const struct rec_sysmat_block *b = &S->block[c];
        h->brick[c] = pvx_calloc(bricks, sizeof **h->brick);
        h->sat[c] = pvx_calloc((size_t)(b->bw + 1) * (size_t)(b->bh + 1), sizeof **h->sat);
        ok = h->brick[c] != NULL && h->sat[c] != NULL;
        for (size_t i = 0; ok && i < bricks; i++) {
            size_t layer = (size_t)h->nb[0] * (size_t)h->nb[1];
            int32_t ijk[3] = {(int32_t)(i % (size_t)h->nb[0]),
                              (int32_t)(i % layer / (size_t)h->nb[0]), (int32_t)(i / layer)};
            h->brick[c][i] = brick_rect(S, c, ijk);
        }
    }
    if (!ok) {
        rec_hull_free(&h);
        return PVX_ENOMEM;
    }
    *out = h;
    return PVX_OK;
}

void rec_hull_free(rec_hull **hp)
{
    rec_hull *h = *hp;
    if (h == NULL)
        return;
    size_t n = rec_grid_count(&h->S->grid);
    for (size_t c = 0; c < h->S->n_cameras; c++) {
        free(h->brick[c]);
        free(h->sat[c]);
    }
    pvx_unreserve(h->col, n * sizeof *h->col);
    pvx_unreserve(h->klass, n);
    free(h->keep);
    free(h->slab_n);
    free(h->slab_counts);
    free(h);
    *hp = NULL;
}

struct carve {
    rec_hull *h;
    const struct rec_hull_params *p;
    const uint8_t *const *lit;
    const bool *present;
    int32_t *col;
    uint8_t *klass;
    int32_t offset[REC_GRID_MAX / BRICK + 1];
};

static void table_camera(void *ctx, size_t c)
{
    struct carve *t = ctx;
    if (!t->present[c])
        return;
    const struct rec_sysmat_block *b = &t->h->S->block[c];
    size_t w = (size_t)b->bw + 1;
    uint32_t *sat = t->h->sat[c]; /* first row and column stay 0 */
    for (int32_t y = 0; y < b->bh; y++) {
        const uint8_t *lit = t->lit[c] + (size_t)y * (size_t)b->bw;
        uint32_t *above = sat + (size_t)y * w, *here = above + w, run = 0;
        for (int32_t x = 0; x < b->bw; x++) {
            run += lit[x] != 0;
            here[x + 1] = above[x + 1] + run;
        }
    }
}

static inline uint32_t lit_in(const uint32_t *sat, size_t w, struct rec_rect r)
{
    size_t top = (size_t)r.y0 * w, bottom = ((size_t)r.y1 + 1) * w, left = r.x0,
           right = (size_t)r.x1 + 1;
    return sat[bottom + right] - sat[bottom + left] - sat[top + right] + sat[top + left];
}

static inline uint32_t area(struct rec_rect r)
{
    return (uint32_t)(r.x1 - r.x0 + 1) * (uint32_t)(r.y1 - r.y0 + 1);
}

/* The image's edge may cut the footprint short: what is beside it is not known, so that its being dark
 * says nothing of the voxel. */
static inline bool cut_off(const struct rec_sysmat_block *b, struct rec_rect r)
{
    return r.x0 == 0 || r.y0 == 0 || r.x1 + 1 == b->bw || r.y1 + 1 == b->bh;
}

enum { DROP, TEST, INSIDE };

/* Whole brick: DROP when some camera sees all of it and nothing lit there; INSIDE when every present
 * camera sees all of it, all lit. */
static uint8_t brick_class(const struct carve *t, size_t brick)
{
    const rec_hull *h = t->h;
    uint32_t views = 0;
    bool inside = true;
    for (size_t c = 0; c < h->S->n_cameras; c++) {
        if (!t->present[c])
            continue;
        struct rec_rect r = h->brick[c][brick];
        if (!rec_rect_seen(r)) {
            inside = false;
            continue;
        }
        uint32_t lit = lit_in(h->sat[c], (size_t)h->S->block[c].bw + 1, r);
        if (lit == 0 && !cut_off(&h->S->block[c], r))
            return DROP;
        inside = inside && lit == area(r);
        views++;
    }
    return inside && views > 0 && views >= t->p->min_views ? INSIDE : TEST;
}

/* Rule (1) of hull.h for one voxel. */
static uint8_t voxel_class(const struct carve *t, int32_t j)
{
    const rec_sysmat *S = t->h->S;
    uint32_t views = 0;
    bool inside = true;
    for (size_t c = 0; c < S->n_cameras; c++) {
        if (!t->present[c])
            continue;
        struct rec_rect r = S->block[c].fp[j];
        if (!rec_rect_seen(r))
            continue;
        uint32_t lit = lit_in(t->h->sat[c], (size_t)S->block[c].bw + 1, r);
        if (lit == 0) {
            if (!cut_off(&S->block[c], r))
                return 0;
            inside = false;
            continue;
        }
        inside = inside && lit == area(r);
        views++;
    }
    if (views == 0 || views < t->p->min_views)
        return 0;
    return inside ? 2 : 1;
}

static void carve_slab(void *ctx, size_t bz)
{
    struct carve *t = ctx;
    rec_hull *h = t->h;
    const struct rec_grid *g = &h->S->grid;
    size_t layer = (size_t)h->nb[0] * (size_t)h->nb[1];
    uint8_t *keep = h->keep + bz * layer;
    for (size_t i = 0; i < layer; i++)
        keep[i] = brick_class(t, bz * layer + i);

    struct rec_hull_counts cn = {0};
    int32_t k0 = (int32_t)bz * BRICK, k1 = k0 + BRICK < g->n[2] ? k0 + BRICK : g->n[2];
    int32_t *col = h->col + (size_t)rec_grid_index(g, 0, 0, k0);
    uint8_t *klass = h->klass + (size_t)rec_grid_index(g, 0, 0, k0);
    int32_t n = 0;
    for (int32_t k = k0; k < k1; k++)
        for (int32_t j = 0; j < g->n[1]; j++)
            for (int32_t bx = 0; bx < h->nb[0]; bx++) {
                uint8_t b = keep[(size_t)(j / BRICK) * (size_t)h->nb[0] + (size_t)bx];
                int32_t i1 = (bx + 1) * BRICK < g->n[0] ? (bx + 1) * BRICK : g->n[0];
                for (int32_t i = bx * BRICK; b != DROP && i < i1; i++) {
                    int32_t v = rec_grid_index(g, i, j, k);
                    uint8_t cl = b == INSIDE ? 2 : voxel_class(t, v);
                    cn.partial += cl == 1;
                    cn.inside += cl == 2;
                    if (cl == 2 || (cl == 1 && t->p->keep_partial)) {
                        col[n] = v;
                        klass[n++] = cl;
                    }
                }
            }
    cn.outside = (int64_t)g->n[0] * g->n[1] * (k1 - k0) - cn.inside - cn.partial;
    h->slab_n[bz] = n;
    h->slab_counts[bz] = cn;
}

static void collect_slab(void *ctx, size_t bz)
{
    struct carve *t = ctx;
    const rec_hull *h = t->h;
    const struct rec_grid *g = &h->S->grid;
    size_t from = (size_t)rec_grid_index(g, 0, 0, (int32_t)bz * BRICK);
    memcpy(t->col + t->offset[bz], h->col + from, (size_t)h->slab_n[bz] * sizeof *t->col);
    if (t->klass == NULL)
        return;
    int32_t k1 = ((int32_t)bz + 1) * BRICK < g->n[2] ? ((int32_t)bz + 1) * BRICK : g->n[2];
    size_t to = (size_t)rec_grid_index(g, 0, 0, k1);
    memset(t->klass + from, 0, to - from);
    for (int32_t i = 0; i < h->slab_n[bz]; i++)
        t->klass[h->col[from + (size_t)i]] = h->klass[from + (size_t)i];
}

void rec_hull_carve(rec_hull *h, const struct rec_hull_params *p, const uint8_t *const *lit,
                    const bool *present, pvx_pool *pool, int32_t *col, int32_t *n, uint8_t *klass,
                    struct rec_hull_counts *counts)
{
    struct carve t = {.h = h, .p = p, .lit = lit, .present = present, .col = col, .klass = klass};
    pvx_pool_run(pool, h->S->n_cameras, table_camera, &t);
    pvx_pool_run(pool, (size_t)h->nb[2], carve_slab, &t);
    int32_t total = 0;
    struct rec_hull_counts sum = {0};
    for (int32_t z = 0; z < h->nb[2]; z++) {
        t.offset[z] = total;
        total += h->slab_n[z];
        sum.inside += h->slab_counts[z].inside;
        sum.partial += h->slab_counts[z].partial;
        sum.outside += h->slab_counts[z].outside;
    }
    pvx_pool_run(pool, (size_t)h->nb[2], collect_slab, &t);
    *n = total;
    if (counts != NULL)
        *counts = sum;
}
