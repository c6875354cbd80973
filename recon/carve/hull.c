#include "recon/carve/hull.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/carve/bands.h"

#define BRICK 4
#define AHEAD 4 /* bricks whose footprints are fetched before they are needed */

/* Bricks are BRICK^3 voxels, x fastest; a row of them along x is looked at by one task, and so is a layer
 * of voxels.  Because voxel order is z-major the layers' results only have to be put end to end. */
struct rec_hull {
    const rec_sysmat *S;
    int32_t nb[3];
    struct rec_rect *brick[REC_MAX_CAMERAS]; /* [bricks]: union of members' footprints, "unseen"
                                                where a member is unseen: such a camera can not
                                                drop the brick as a whole */
    uint32_t *sat[REC_MAX_CAMERAS];   /* [(bh+1)*(bw+1)] lit bins above and left of a corner */
    uint8_t *column[REC_MAX_CAMERAS]; /* [bands][bw] lit bins of a band's columns */
    struct rec_bands bands;
    struct brick {
        uint64_t open;  /* cameras whose bins voxels have to look at themselves */
        uint32_t views; /* the others that see it: all of it, all lit */
        bool keep;
    } * brick_state; /* [bricks] */
    int32_t *col;    /* [N] kept voxels of each layer, from the layer's start */
    uint8_t *klass;  /* [N] their class, 1 or 2 */
    struct layer {
        int32_t n;
        struct rec_hull_counts counts;
    } * layer; /* [n z] */
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
    h->brick_state = pvx_calloc(bricks, sizeof *h->brick_state);
    h->layer = pvx_calloc((size_t)S->grid.n[2], sizeof *h->layer);
    h->col = pvx_reserve(n * sizeof *h->col);
    h->klass = pvx_reserve(n);
    bool ok = h->brick_state != NULL && h->layer != NULL && h->col != NULL && h->klass != NULL;
    for (size_t c = 0; ok && c < S->n_cameras; c++) {
        const struct rec_sysmat_block *b = &S->block[c];
        h->brick[c] = pvx_calloc(bricks, sizeof **h->brick);
        h->sat[c] = pvx_calloc((size_t)(b->bw + 1) * (size_t)(b->bh + 1), sizeof **h->sat);
        h->column[c] = pvx_calloc(rec_band_count(b->bh), (size_t)b->bw);
        rec_bands_add(&h->bands, b->bh);
        ok = h->brick[c] != NULL && h->sat[c] != NULL && h->column[c] != NULL;
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
    rec_sysmat_let_go(S); /* no frame set needs all footprints */
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
        free(h->column[c]);
    }
    pvx_unreserve(h->col, n * sizeof *h->col);
    pvx_unreserve(h->klass, n);
    free(h->brick_state);
    free(h->layer);
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
    int32_t offset[REC_GRID_MAX];
};

/* A table is a sum over all rows above.  So that its bands can be summed apart from each other, their
 * columns are counted first; a byte holds a band's rows. */
static void count_band(void *ctx, size_t task)
{
    struct carve *t = ctx;
    int32_t band, y0, y1;
    size_t c = rec_bands_find(&t->h->bands, task, &band);
    size_t w = (size_t)t->h->S->block[c].bw;
    uint8_t *restrict column = t->h->column[c] + (size_t)band * w;
    if (!t->present[c])
        return;
    rec_band_rows(band, t->h->S->block[c].bh, &y0, &y1);
    memset(column, 0, w);
    const uint8_t *restrict lit = t->lit[c] + (size_t)y0 * w;
    for (int32_t y = y0; y < y1; y++, lit += w)
        for (size_t x = 0; x < w; x++)
            column[x] = (uint8_t)(column[x] + (lit[x] != 0));
}

static void table_band(void *ctx, size_t task)
{
    struct carve *t = ctx;
    int32_t band, y0, y1;
    size_t c = rec_bands_find(&t->h->bands, task, &band);
    size_t bw = (size_t)t->h->S->block[c].bw, w = bw + 1;
    if (!t->present[c])
        return;
    rec_band_rows(band, t->h->S->block[c].bh, &y0, &y1);
    const uint8_t *lit = t->lit[c] + (size_t)y0 * bw, *column = t->h->column[c];
    uint32_t *here = t->h->sat[c] + ((size_t)y0 + 1) * w + 1; /* first row and column stay 0 */
    memset(here, 0, bw * sizeof *here);
    for (size_t k = 0; k < (size_t)band; k++, column += bw)
        for (size_t x = 0; x < bw; x++)
            here[x] += column[x];
    uint32_t run = 0;
    for (size_t x = 0; x < bw; x++)
        here[x] = run += here[x] + (lit[x] != 0);
    for (int32_t y = y0 + 1; y < y1; y++) {
        const uint32_t *above = here;
        here += w;
        lit += bw;
        run = 0;
        for (size_t x = 0; x < bw; x++) {
            run += lit[x] != 0;
            here[x] = above[x] + run;
        }
    }
}

/* Lit and dark bins of a footprint. */
struct seen {
    uint32_t lit, dark;
};
static inline struct seen look(const rec_hull *h, size_t c, struct rec_rect r)
{
    const uint32_t *sat = h->sat[c];
    size_t w = (size_t)h->S->block[c].bw + 1, top = (size_t)r.y0 * w,
           bottom = ((size_t)r.y1 + 1) * w, left = r.x0, right = (size_t)r.x1 + 1;
    uint32_t lit = sat[bottom + right] - sat[bottom + left] - sat[top + right] + sat[top + left];
    uint32_t area = (uint32_t)(r.x1 - r.x0 + 1) * (uint32_t)(r.y1 - r.y0 + 1);
    return (struct seen){lit, area - lit};
}

/* The image's edge may cut the footprint short: what is beside it is not known, so that its being dark
 * says nothing of the voxel. */
static inline bool cut_off(const struct rec_sysmat_block *b, struct rec_rect r)
{
    return r.x0 == 0 || r.y0 == 0 || r.x1 + 1 == b->bw || r.y1 + 1 == b->bh;
}

/* A whole brick: it goes when some camera sees all of it and nothing lit there. */
static struct brick look_at_brick(const struct carve *t, size_t brick)
{
    const rec_hull *h = t->h;
    struct brick b = {.keep = true};
    for (size_t c = 0; c < h->S->n_cameras; c++) {
        if (!t->present[c])
            continue;
        struct rec_rect r = h->brick[c][brick];
        struct seen s = {1, 1};
        if (rec_rect_seen(r))
            s = look(h, c, r);
        if (s.lit == 0 && !cut_off(&h->S->block[c], r))
            return (struct brick){0};
        b.open |= (uint64_t)(s.dark != 0) << c;
        b.views += s.dark == 0;
    }
    return b;
}

/* Rule (1) of hull.h for one voxel of a brick. */
static uint8_t voxel_class(const struct carve *t, const struct brick *b, int32_t j)
{
    const rec_sysmat *S = t->h->S;
    uint32_t views = b->views;
    bool inside = true;
    for (uint64_t open = b->open; open != 0; open &= open - 1) {
        size_t c = (size_t)__builtin_ctzll(open);
        struct rec_rect r = S->block[c].fp[j];
        if (!rec_rect_seen(r))
            continue;
        struct seen s = look(t->h, c, r);
        if (s.lit == 0) {
            if (!cut_off(&S->block[c], r))
                return 0;
            inside = false;
            continue;
        }
        inside = inside && s.dark == 0;
        views++;
    }
    if (views == 0 || views < t->p->min_views)
        return 0;
    return inside ? 2 : 1;
}

/* Footprints lie [N] apart for each camera and rows of a brick a row of voxels apart, which no
 * processor foresees. */
static inline void fetch(const struct carve *t, const struct brick *b, int32_t j)
{
    for (uint64_t open = b->open; open != 0; open &= open - 1)
        __builtin_prefetch(t->h->S->block[__builtin_ctzll(open)].fp + j);
}

static void look_at_bricks(void *ctx, size_t row)
{
    struct carve *t = ctx;
    size_t n = (size_t)t->h->nb[0];
    for (size_t i = row * n; i < (row + 1) * n; i++)
        t->h->brick_state[i] = look_at_brick(t, i);
}

static void carve_layer(void *ctx, size_t z)
{
    struct carve *t = ctx;
    rec_hull *h = t->h;
    const struct rec_grid *g = &h->S->grid;
    const int32_t k = (int32_t)z, *nb = h->nb;
    const struct brick *brick = h->brick_state + (size_t)(k / BRICK) * (size_t)(nb[0] * nb[1]);
    int32_t *col = h->col + (size_t)rec_grid_index(g, 0, 0, k);
    uint8_t *klass = h->klass + (size_t)rec_grid_index(g, 0, 0, k);
    struct layer out = {0};
    for (int32_t j = 0; j < g->n[1]; j++)
        for (int32_t bx = 0; bx < nb[0]; bx++) {
            const struct brick *b = &brick[(j / BRICK) * nb[0] + bx];
            if (bx + AHEAD < nb[0])
                fetch(t, b + AHEAD, rec_grid_index(g, (bx + AHEAD) * BRICK, j, k));
            int32_t i1 = (bx + 1) * BRICK < g->n[0] ? (bx + 1) * BRICK : g->n[0];
            for (int32_t i = bx * BRICK; b->keep && i < i1; i++) {
                int32_t v = rec_grid_index(g, i, j, k);
                uint8_t cl = voxel_class(t, b, v);
                out.counts.partial += cl == 1;
                out.counts.inside += cl == 2;
                if (cl == 2 || (cl == 1 && t->p->keep_partial)) {
                    col[out.n] = v;
                    klass[out.n++] = cl;
                }
            }
        }
    out.counts.outside = (int64_t)g->n[0] * g->n[1] - out.counts.inside - out.counts.partial;
    h->layer[z] = out;
}

static void collect_layer(void *ctx, size_t z)
{
    struct carve *t = ctx;
    const rec_hull *h = t->h;
    const struct rec_grid *g = &h->S->grid;
    size_t from = (size_t)rec_grid_index(g, 0, 0, (int32_t)z);
    memcpy(t->col + t->offset[z], h->col + from, (size_t)h->layer[z].n * sizeof *t->col);
    if (t->klass == NULL)
        return;
    memset(t->klass + from, 0, (size_t)g->n[0] * (size_t)g->n[1]);
    for (int32_t i = 0; i < h->layer[z].n; i++)
        t->klass[h->col[from + (size_t)i]] = h->klass[from + (size_t)i];
}

void rec_hull_carve(rec_hull *h, const struct rec_hull_params *p, const uint8_t *const *lit,
                    const bool *present, pvx_pool *pool, struct rec_hull_kept *out)
{
    struct carve t = {
        .h = h, .p = p, .lit = lit, .present = present, .col = out->col, .klass = out->klass};
    const size_t layers = (size_t)h->S->grid.n[2];
    pvx_pool_run(pool, rec_bands_all(&h->bands), count_band, &t);
    pvx_pool_run(pool, rec_bands_all(&h->bands), table_band, &t);
    pvx_pool_run(pool, (size_t)h->nb[1] * (size_t)h->nb[2], look_at_bricks, &t);
    pvx_pool_run(pool, layers, carve_layer, &t);
    int32_t total = 0;
    struct rec_hull_counts sum = {0};
    for (size_t z = 0; z < layers; z++) {
        t.offset[z] = total;
        total += h->layer[z].n;
        sum.inside += h->layer[z].counts.inside;
        sum.partial += h->layer[z].counts.partial;
        sum.outside += h->layer[z].counts.outside;
    }
    pvx_pool_run(pool, layers, collect_layer, &t);
    out->n = total;
    out->counts = sum;
}
