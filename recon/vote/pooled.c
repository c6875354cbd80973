/* pooled.c - pictures on the vote's coarse bins, and the columns where a flame may be. */
#include <string.h>

#include "recon/vote/impl.h"

/* A coarse bin counts when this share of its bins was measured.  The saturated ones are brighter than the rest. */
#define MEASURED 0.75F

struct bin {
    rec_f4 sum, weight;
    float bright; /* sum over the bins that were not measured */
    uint32_t n;
};

REC_INLINE void add_bin(const struct rec_vote_set *set, size_t i, size_t cs, bool per_channel,
                        struct bin *o)
{
    const struct rec_pictures *in = set->in;
    rec_f4 w = per_channel ? rec_ld(in->w, i, 4) : rec_splat(in->w[i]);
    rec_f4 b = rec_ld(in->b, i, cs);
    o->sum += w * b;
    o->weight += w;
    o->bright += w[0] + w[1] + w[2] == 0 ? b[0] : 0;
}

/* The bins of S below bin (x,y) of the level. */
REC_INLINE struct bin gather(const rec_vote *v, size_t c, int32_t x, int32_t y, size_t cs,
                             bool per_channel)
{
    const struct rec_sysmat_block *f = &v->S->block[c];
    int32_t side = 1 << v->shift, x0 = x * side, y0 = y * side;
    if (per_channel && side == 1) { /* a bin of a mosaic has one channel: four have all */
        side = 2;
        x0 &= ~1;
        y0 &= ~1;
    }
    int32_t x1 = x0 + side < f->bw ? x0 + side : f->bw, y1 = y0 + side < f->bh ? y0 + side : f->bh;
    struct bin o = {.n = (uint32_t)((x1 - x0) * (y1 - y0))};
    for (int32_t j = y0; j < y1; j++) {
        size_t row = v->S->row0[c] + (size_t)j * (size_t)f->bw;
        for (int32_t i = x0; i < x1; i++)
            add_bin(v->set, row + (size_t)i, cs, per_channel, &o);
    }
    return o;
}

/* The sum of the channels, each the mean of its measured bins; false: too few were measured. */
static bool pooled_settle(const struct bin *o, int channels, bool per_channel, float *value)
{
    float least = MEASURED * (float)o->n, sum = 0;
    if (per_channel) /* a filter passes one channel per bin; red and blue have a quarter of the bins */
        least *= o->weight[0] + o->weight[1] + o->weight[2] <= 1.01F * (float)o->n ? 0.2F : 1;
    for (int l = 0; l < channels; l++) {
        if (!(o->weight[l] >= least) || o->weight[l] <= 0)
            return false;
        sum += o->sum[l] / o->weight[l];
    }
    *value = sum;
    return true;
}

static void put_bin(rec_vote *v, size_t i, const struct bin *o, struct rec_vote_camera *s)
{
    const struct rec_vote_set *set = v->set;
    float value = 0;
    bool ok = pooled_settle(o, set->channels, set->in->per_channel, &value);
    v->b[i] = ok ? value : 0;
    v->use[i] = ok ? 1 : 0;
    s->measured += ok;
    s->unknown += !ok;
    s->saturated += !ok && o->bright > 0;
    s->power += ok ? (double)value * value : 0;
}

/* Pools the bins of camera c.  A bin that is not lit and sees no column is skipped: it carries no information. */
static void pooled_pool_camera(void *ctx, size_t c)
{
    rec_vote *v = ctx;
    const struct rec_vote_set *set = v->set;
    const struct rec_sysmat_block *blk = &v->level->block[c];
    struct rec_vote_camera *s = &v->of[c];
    size_t i = v->level->row0[c];
    for (int32_t y = 0; y < blk->bh && set->present[c]; y++)
        for (int32_t x = 0; x < blk->bw; x++, i++) {
            if (!v->asked[i])
                continue;
            struct bin o = set->in->per_channel ? gather(v, c, x, y, 4, true)
                           : set->channels == 3 ? gather(v, c, x, y, 4, false)
                                                : gather(v, c, x, y, 1, false);
            put_bin(v, i, &o, s);
        }
    double side = (double)((uint64_t)1 << v->shift);
    double noise = v->weigh[c] * (double)set->noise[c] / (side * side);
    s->signal = v->weigh[c] * s->power - noise * s->measured;
    s->noise = noise * (s->bins - s->unknown);
}

void rec_vote_pool(rec_vote *v)
{
    size_t n = v->level->row0[v->cameras];
    memcpy(v->asked, v->lit, n);
    REC_FOR_BINS (i, v->sub, ((struct rec_block_range){0, v->sub->n_blocks}), 1)
        v->asked[i] = 1;
    for (size_t i = 0; i < n; i++)
        v->asked[i] &= v->chord[i] > 0;
    memset(v->b, 0, n * sizeof *v->b);
    memset(v->use, 0, n * sizeof *v->use);
    pvx_pool_run(v->pool, v->cameras, pooled_pool_camera, v);
}

/* The union of the silhouette rows [j0,j1) of camera c, as one row. */
static const uint8_t *merge_rows(const rec_vote *v, size_t c, int32_t j0, int32_t j1)
{
    size_t w = (size_t)v->S->block[c].bw, at = v->S->row0[c];
    uint8_t *row = v->merged + v->merged_at[c];
    memcpy(row, v->set->lit + at + (size_t)j0 * w, w);
    for (int32_t j = j0 + 1; j < j1; j++) {
        const uint8_t *lit = v->set->lit + at + (size_t)j * w;
        for (size_t i = 0; i < w; i++)
            row[i] |= lit[i];
    }
    return row;
}

static bool any_of(const uint8_t *p, int32_t n)
{
    uint32_t four, any = 0;
    for (; n >= 4; n -= 4, p += 4) {
        memcpy(&four, p, sizeof four);
        any |= four;
    }
    for (; n > 0; n--)
        any |= *p++;
    return any != 0;
}

/* The level's lit bins, and their summed-area table. */
static void light_camera(void *ctx, size_t c)
{
    rec_vote *v = ctx;
    const struct rec_sysmat_block *blk = &v->level->block[c], *fine = &v->S->block[c];
    size_t i = v->level->row0[c], w = (size_t)blk->bw + 1;
    int32_t side = 1 << v->shift;
    struct rec_vote_camera s = {0};
    memset(v->lit + i, 0, (size_t)blk->bw * (size_t)blk->bh);
    for (int32_t y = 0; y < blk->bh && v->set->present[c]; y++) {
        uint32_t run = 0, *here = v->table[c] + (size_t)(y + 1) * w + 1;
        int32_t end = (y + 1) * side < fine->bh ? (y + 1) * side : fine->bh;
        const uint8_t *row = merge_rows(v, c, y * side, end);
        for (int32_t x = 0, at = 0; x < blk->bw; x++, i++, here++, at += side) {
            bool meets = v->chord[i] > 0;
            v->lit[i] = any_of(row + at, fine->bw - at < side ? fine->bw - at : side);
            here[0] = *(here - w) + (run += v->lit[i]);
            s.bins += meets;
            s.lit += meets && v->lit[i];
        }
    }
    v->of[c] = s;
}

void rec_vote_light(rec_vote *v)
{
    pvx_pool_run(v->pool, v->cameras, light_camera, v);
}

/* Number of lit bins in a footprint. */
static uint32_t lit_in(const rec_vote *v, size_t c, struct rec_rect r)
{
    size_t w = (size_t)v->level->block[c].bw + 1, top = (size_t)r.y0 * w;
    size_t bottom = ((size_t)r.y1 + 1) * w, left = r.x0, right = (size_t)r.x1 + 1;
    const uint32_t *t = v->table[c];
    return t[bottom + right] - t[bottom + left] - t[top + right] + t[top + left];
}

static bool may_burn(const rec_vote *v, size_t place)
{
    int dark = 0, lit = 0;
    for (size_t k = 0; k < v->n_darkest; k++) {
        size_t c = v->darkest[k];
        const struct rec_sysmat_block *b = &v->level->block[c];
        struct rec_rect r = b->fp[place];
        if (!rec_rect_seen(r))
            continue;
        if (lit_in(v, c, r) > 0) {
            lit++;
            continue;
        }
        bool cut = (r.x0 == 0) | (r.y0 == 0) | (r.x1 + 1 == b->bw) | (r.y1 + 1 == b->bh);
        dark += !cut;
        if (dark > v->dark_allowed)
            return false;
    }
    return lit >= 2;
}

static void pooled_mark_layer(void *ctx, size_t k)
{
    rec_vote *v = ctx;
    const struct rec_grid *g = &v->level->grid;
    int32_t n = 0, first = rec_grid_index(g, 0, 0, (int32_t)k);
    for (int32_t j = 0; j < g->n[1]; j++)
        for (int32_t i = 0; i < g->n[0]; i++)
            if (may_burn(v, rec_brick_place(g, i, j, (int32_t)k)))
                v->col[first + n++] = rec_grid_index(g, i, j, (int32_t)k);
    v->in_layer[k] = n;
}

/* Cameras that take part, those with the fewest lit bins first: they are most likely dark. */
static void find_darkest(rec_vote *v)
{
    v->n_darkest = 0;
    for (size_t c = 0; c < v->cameras; c++) {
        if (!v->set->present[c])
            continue;
        size_t k = v->n_darkest++;
        for (; k > 0 && v->of[v->darkest[k - 1]].lit > v->of[c].lit; k--)
            v->darkest[k] = v->darkest[k - 1];
        v->darkest[k] = c;
    }
}

bool rec_vote_restrict(rec_vote *v, struct rec_restrictor *r)
{
    const struct rec_grid *g = &v->level->grid;
    int32_t n = 0;
    find_darkest(v);
    pvx_pool_run(v->pool, (size_t)g->n[2], pooled_mark_layer, v);
    for (int32_t k = 0; k < g->n[2]; k++) {
        size_t some = (size_t)v->in_layer[k];
        memmove(v->col + n, v->col + rec_grid_index(g, 0, 0, k), some * sizeof *v->col);
        n += v->in_layer[k];
    }
    rec_subsys_restrict(v->sub, r, v->col, n, v->set->present);
    return v->sub->n > 0 && v->sub->n_blocks > 0;
}
