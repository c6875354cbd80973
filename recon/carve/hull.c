#include "recon/carve/hull.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/carve/bands.h"
#include "recon/carve/hull_bricks.h"
#include "recon/matrix/active.h"

#define BRICK  REC_BRICK
#define VOXELS REC_BRICK_VOXELS

/* Bricks are BRICK^3 voxels, x fastest.  One task handles a row of bricks along x and counts the voxels that it keeps
 * in each of its rows of voxels.  These counts tell each layer of voxels where its part of the list begins. */
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
        uint64_t open;  /* cameras in which the single voxels have to be tested */
        uint32_t views; /* other cameras, which see all of it, all lit */
        bool keep;
    } * brick_state; /* [bricks] */
    uint8_t *klass;  /* [bricks][VOXELS] class of a voxel: 1 partial, 2 inside, 0 not kept */
    int32_t *at;     /* [n z][n y] voxels kept in a row; later: before the row */
    struct row {
        int64_t inside, partial, cut;
    } * row; /* [rows of bricks] */
};

/* Number of voxels along each axis that a brick has in the grid. */
struct extent {
    int32_t n[3];
};
static struct extent extent_of(const struct rec_grid *g, size_t brick)
{
    int32_t b = (int32_t)brick, nx = rec_bricks(g, 0), ny = rec_bricks(g, 1);
    const int32_t at[3] = {b % nx, b / nx % ny, b / nx / ny};
    struct extent e;
    for (int a = 0; a < 3; a++) {
        int32_t left = g->n[a] - at[a] * BRICK;
        e.n[a] = left < BRICK ? left : BRICK;
    }
    return e;
}
/* Whether the brick's place o is a voxel. */
static bool is_voxel(const struct extent *e, int32_t o)
{
    return o % BRICK < e->n[0] && o / BRICK % BRICK < e->n[1] && o / (BRICK * BRICK) < e->n[2];
}

struct rec_rect rec_hull_rect(const rec_sysmat *S, size_t c, size_t brick)
{
    const struct rec_rect *fp = S->block[c].fp + brick * VOXELS;
    const struct extent e = extent_of(&S->grid, brick);
    struct rec_rect u = {.x0 = UINT16_MAX, .y0 = UINT16_MAX, .x1 = 0, .y1 = 0};
    for (int32_t o = 0; o < VOXELS; o++) {
        if (!is_voxel(&e, o))
            continue;
        if (!rec_rect_seen(fp[o]))
            return REC_RECT_UNKNOWN;
        u.x0 = fp[o].x0 < u.x0 ? fp[o].x0 : u.x0;
        u.y0 = fp[o].y0 < u.y0 ? fp[o].y0 : u.y0;
        u.x1 = fp[o].x1 > u.x1 ? fp[o].x1 : u.x1;
        u.y1 = fp[o].y1 > u.y1 ? fp[o].y1 : u.y1;
    }
    return u;
}

pvx_err rec_hull_new(const rec_sysmat *S, rec_hull **out)
{
    *out = NULL;
    rec_hull *h = pvx_calloc(1, sizeof *h);
    PVX_NEED(h);
    h->S = S;
    for (int a = 0; a < 3; a++)
        h->nb[a] = rec_bricks(&S->grid, a);
    size_t bricks = rec_brick_places(&S->grid) / VOXELS;
    size_t rows = (size_t)S->grid.n[1] * (size_t)S->grid.n[2];
    h->brick_state = pvx_calloc(bricks, sizeof *h->brick_state);
    h->row = pvx_calloc((size_t)h->nb[1] * (size_t)h->nb[2], sizeof *h->row);
    h->at = pvx_calloc(rows, sizeof *h->at);
    h->klass = pvx_reserve(rec_brick_places(&S->grid));
    const struct rec_active *part = S->active;
    bool ok = h->brick_state != NULL && h->row != NULL && h->at != NULL && h->klass != NULL;
    for (size_t c = 0; ok && c < S->n_cameras; c++) {
        const struct rec_sysmat_block *b = &S->block[c];
        h->brick[c] = part != NULL ? part->rect[c] : pvx_calloc(bricks, sizeof **h->brick);
        h->sat[c] = pvx_calloc((size_t)(b->bw + 1) * (size_t)(b->bh + 1), sizeof **h->sat);
        h->column[c] = pvx_calloc(rec_band_count(b->bh), (size_t)b->bw);
        rec_bands_add(&h->bands, b->bh);
        ok = h->brick[c] != NULL && h->sat[c] != NULL && h->column[c] != NULL;
        for (size_t i = 0; ok && part == NULL && i < bricks; i++)
            h->brick[c][i] = rec_hull_rect(S, c, i);
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
    for (size_t c = 0; c < h->S->n_cameras; c++) {
        if (h->S->active == NULL)
            free(h->brick[c]);
        free(h->sat[c]);
        free(h->column[c]);
    }
    pvx_unreserve(h->klass, rec_brick_places(&h->S->grid));
    free(h->brick_state);
    free(h->at);
    free(h->row);
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
    uint8_t *brick;
};

/* A summed-area table sums over all rows above.  Counting the columns of every band first makes the bands of the
 * table independent of each other.  A byte can hold the number of rows in a band. */
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

/* A camera's silhouette; a copy, so that no store of a byte can change it. */
struct view {
    const uint32_t *sat;
    int32_t bw, bh;
};
static inline struct view hull_view_of(const rec_hull *h, size_t c)
{
    return (struct view){h->sat[c], h->S->block[c].bw, h->S->block[c].bh};
}

/* Lit and dark bins of a footprint. */
struct seen {
    uint32_t lit, dark;
};
static inline struct seen hull_look(struct view v, struct rec_rect r)
{
    size_t w = (size_t)v.bw + 1, top = (size_t)r.y0 * w, bottom = ((size_t)r.y1 + 1) * w;
    size_t left = r.x0, right = (size_t)r.x1 + 1;
    uint32_t lit =
        v.sat[bottom + right] - v.sat[bottom + left] - v.sat[top + right] + v.sat[top + left];
    uint32_t area = (uint32_t)(r.x1 - r.x0 + 1) * (uint32_t)(r.y1 - r.y0 + 1);
    return (struct seen){lit, area - lit};
}

/* Whether the image's edge may cut the footprint short.  What lies outside is not known, so a dark footprint then
 * proves nothing about the voxel. */
static inline bool hull_cut_off(struct view v, struct rec_rect r)
{
    return (r.x0 == 0) | (r.y0 == 0) | (r.x1 + 1 == v.bw) | (r.y1 + 1 == v.bh);
}

/* Tests a whole brick.  It is dropped if some camera sees all of it and nothing lit there, or if fewer than min_views
 * cameras may see flame there. */
static struct brick look_at_brick(const struct carve *t, size_t brick)
{
    const rec_hull *h = t->h;
    struct brick b = {.keep = true};
    uint32_t may = 0;
    for (size_t c = 0; c < h->S->n_cameras; c++) {
        if (!t->present[c])
            continue;
        struct rec_rect r = h->brick[c][brick];
        struct seen s = {1, 1};
        if (rec_rect_seen(r))
            s = hull_look(hull_view_of(h, c), r);
        if (s.lit == 0 && !hull_cut_off(hull_view_of(h, c), r))
            return (struct brick){0};
        may += rec_rect_unknown(r) || (rec_rect_seen(r) && s.lit != 0);
        b.open |= (uint64_t)(s.dark != 0) << c;
        b.views += s.dark == 0;
    }
    b.keep = may >= t->p->min_views;
    return b;
}

/* Rule (1) of hull.h for the voxels of a brick, one camera after the other, without unpredictable branches. */
struct voxels {
    uint8_t gone[VOXELS], part[VOXELS]; /* dark in some camera; not all lit in some */
    uint8_t views[VOXELS];
};
static void look_at_voxels(struct view view, const struct rec_rect *fp, struct voxels *v)
{
    for (int32_t o = 0; o < VOXELS; o++) {
        if (!rec_rect_seen(fp[o]))
            continue;
        struct seen s = hull_look(view, fp[o]);
        v->gone[o] |= (s.lit == 0) & !hull_cut_off(view, fp[o]);
        v->part[o] |= s.dark != 0;
        v->views[o] = (uint8_t)(v->views[o] + (s.lit != 0));
    }
}
static void hull_classify(const struct carve *t, size_t brick, uint8_t *restrict klass)
{
    const rec_hull *h = t->h;
    const struct brick *b = &h->brick_state[brick];
    const struct extent e = extent_of(&h->S->grid, brick);
    uint32_t wanted = t->p->min_views;
    uint8_t need = (uint8_t)(wanted < 1 ? 1 : wanted < UINT8_MAX ? wanted : UINT8_MAX);
    struct voxels v = {0};
    memset(v.views, (int)b->views, VOXELS);
    for (uint64_t open = b->open; open != 0; open &= open - 1) {
        size_t c = (size_t)__builtin_ctzll(open);
        look_at_voxels(hull_view_of(h, c), h->S->block[c].fp + brick * VOXELS, &v);
    }
    for (int32_t o = 0; o < VOXELS; o++)
        klass[o] = (uint8_t)((v.gone[o] == 0) & (v.views[o] >= need)) * (uint8_t)(2 - v.part[o]);
    if (e.n[0] < BRICK || e.n[1] < BRICK || e.n[2] < BRICK)
        for (int32_t o = 0; o < VOXELS; o++)
            klass[o] *= is_voxel(&e, o);
}

/* Prefetches what hull_classify will read. */
static void hull_fetch(const rec_hull *h, size_t brick)
{
    for (uint64_t open = h->brick_state[brick].open; open != 0; open &= open - 1) {
        const struct rec_rect *fp = h->S->block[__builtin_ctzll(open)].fp + brick * VOXELS;
        for (size_t o = 0; o < VOXELS; o += PVX_ALIGN / sizeof *fp)
            __builtin_prefetch(fp + o);
    }
}

static void carve_row(void *ctx, size_t row)
{
    struct carve *t = ctx;
    rec_hull *h = t->h;
    const struct rec_grid *g = &h->S->grid;
    const size_t n = (size_t)h->nb[0], first = row * n;
    int32_t kept[BRICK * BRICK] = {0};
    struct row out = {0};
    const struct rec_active *part = h->S->active;
    for (size_t i = first; i < first + n; i++) {
        h->brick_state[i] = look_at_brick(t, i);
        if (part == NULL || part->brick[i])
            hull_fetch(h, i);
    }
    for (size_t i = first; i < first + n; i++) {
        uint8_t *klass = h->klass + i * VOXELS;
        if (!h->brick_state[i].keep)
            continue;
        if (part != NULL && !part->brick[i]) {
            h->brick_state[i].keep = false;
            out.cut++;
            continue;
        }
        hull_classify(t, i, klass);
        int32_t partial = 0, inside = 0;
        for (int o = 0; o < VOXELS; o++) {
            partial += klass[o] == 1;
            inside += klass[o] == 2;
        }
        for (int o = 0; !t->p->keep_partial && o < VOXELS; o++)
            klass[o] &= 2;
        for (int o = 0; o < VOXELS; o += BRICK)
            kept[o / BRICK] +=
                (klass[o] != 0) + (klass[o + 1] != 0) + (klass[o + 2] != 0) + (klass[o + 3] != 0);
        out.partial += partial;
        out.inside += inside;
    }
    int32_t j0 = (int32_t)row % h->nb[1] * BRICK, k0 = (int32_t)row / h->nb[1] * BRICK;
    for (int32_t r = 0; r < BRICK * BRICK; r++)
        if (j0 + r % BRICK < g->n[1] && k0 + r / BRICK < g->n[2])
            h->at[(k0 + r / BRICK) * g->n[1] + j0 + r % BRICK] = kept[r];
    h->row[row] = out;
}

static void list_layer(void *ctx, size_t z)
{
    struct carve *t = ctx;
    const rec_hull *h = t->h;
    const struct rec_grid *g = &h->S->grid;
    const int32_t k = (int32_t)z;
    int32_t list[REC_GRID_MAX + BRICK];
    if (t->klass != NULL)
        memset(t->klass + rec_grid_index(g, 0, 0, k), 0, (size_t)g->n[0] * (size_t)g->n[1]);
    for (int32_t j = 0; j < g->n[1]; j++) {
        size_t brick = (size_t)(k / BRICK * h->nb[1] + j / BRICK) * (size_t)h->nb[0], n = 0;
        size_t of_brick = (size_t)(k % BRICK * BRICK + j % BRICK) * BRICK;
        for (int32_t i = 0; i < g->n[0]; i += BRICK, brick++) {
            const uint8_t *klass = h->klass + brick * VOXELS + of_brick;
            int32_t v = rec_grid_index(g, i, j, k);
            if (!h->brick_state[brick].keep)
                continue;
            for (int32_t x = 0; x < BRICK; x++) {
                list[n] = v + x;
                n += klass[x] != 0;
                if (t->klass != NULL && klass[x] != 0)
                    t->klass[v + x] = klass[x];
            }
        }
        memcpy(t->col + h->at[k * g->n[1] + j], list, n * sizeof *list);
    }
}

static void test_row(void *ctx, size_t row)
{
    const struct carve *t = ctx;
    size_t n = (size_t)t->h->nb[0];
    int64_t kept = 0;
    for (size_t i = row * n; i < row * n + n; i++)
        kept += t->brick[i] = look_at_brick(t, i).keep;
    t->h->row[row].partial = kept;
}

size_t rec_hull_bricks(rec_hull *h, const struct rec_hull_params *p, const uint8_t *const *lit,
                       const bool *present, pvx_pool *pool, uint8_t *brick)
{
    struct carve t = {.h = h, .p = p, .lit = lit, .present = present, .brick = brick};
    pvx_pool_run(pool, rec_bands_all(&h->bands), count_band, &t);
    pvx_pool_run(pool, rec_bands_all(&h->bands), table_band, &t);
    size_t rows = (size_t)h->nb[1] * (size_t)h->nb[2], kept = 0;
    pvx_pool_run(pool, rows, test_row, &t);
    for (size_t i = 0; i < rows; i++)
        kept += (size_t)h->row[i].partial;
    return kept;
}

void rec_hull_carve(rec_hull *h, const struct rec_hull_params *p, const uint8_t *const *lit,
                    const bool *present, pvx_pool *pool, struct rec_hull_kept *out)
{
    struct carve t = {
        .h = h, .p = p, .lit = lit, .present = present, .col = out->col, .klass = out->klass};
    const size_t layers = (size_t)h->S->grid.n[2], rows = layers * (size_t)h->S->grid.n[1];
    pvx_pool_run(pool, rec_bands_all(&h->bands), count_band, &t);
    pvx_pool_run(pool, rec_bands_all(&h->bands), table_band, &t);
    pvx_pool_run(pool, (size_t)h->nb[1] * (size_t)h->nb[2], carve_row, &t);
    int32_t total = 0;
    for (size_t i = 0; i < rows; i++) {
        int32_t n = h->at[i];
        h->at[i] = total;
        total += n;
    }
    pvx_pool_run(pool, layers, list_layer, &t);
    struct rec_hull_counts sum = {.outside = (int64_t)rec_grid_count(&h->S->grid)};
    for (size_t i = 0; i < (size_t)h->nb[1] * (size_t)h->nb[2]; i++) {
        sum.inside += h->row[i].inside;
        sum.partial += h->row[i].partial;
        sum.cut += h->row[i].cut;
    }
    sum.outside -= sum.inside + sum.partial;
    out->n = total;
    out->counts = sum;
}
