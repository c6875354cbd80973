/* The code of photo_pass.h; the including file names the function that fills the table, PASSES. */
#include <math.h>
#include <string.h>

#include "recon/carve/photo_pass.h"

#ifdef __AVX2__
#define VEC 8
#else
#define VEC 4
#endif
#define GROUP 32  /* floats that are tested together */
#define CHUNK 256 /* floats whose column sums are kept */
#define BLOCK REC_PHOTO_BLOCK
#define LIMIT REC_PHOTO_LIMIT

typedef float vf __attribute__((vector_size(4 * VEC), aligned(4), may_alias));
typedef int32_t vi __attribute__((vector_size(4 * VEC), aligned(4), may_alias));

/* Selects the pass for a picture's kind; a mosaic has im->cell. */
#define FOR_KIND(im, fn, ...)                               \
    ((im)->cell != NULL ? fn(__VA_ARGS__, (size_t)4, true)  \
     : (im)->nch == 3   ? fn(__VA_ARGS__, (size_t)4, false) \
                        : fn(__VA_ARGS__, (size_t)1, false))

REC_INLINE vf load(const float *v)
{
    return *(const vf *)v;
}
REC_INLINE void store(float *v, vf a)
{
    *(vf *)v = a;
}
REC_INLINE bool any(vi mask)
{
#ifdef __AVX2__
    return _mm256_movemask_ps((__m256)mask) != 0;
#else
    return rec_any(mask);
#endif
}
/* a < b ? a : b */
REC_INLINE vf least(vf a, vf b)
{
#if defined(__AVX2__)
    return _mm256_min_ps(a, b);
#elif defined(__SSE2__)
    return _mm_min_ps(a, b);
#else
    return rec_select(a < b, a, b);
#endif
}
REC_INLINE vf pick(vi mask, vf a, vf b)
{
    return (vf)((mask & (vi)a) | (~mask & (vi)b));
}
/* A vector that repeats the channels of a bin. */
REC_INLINE vf repeat(rec_f4 v, size_t cs)
{
    vf a;
    for (size_t l = 0; l < VEC; l++)
        a[l] = v[l % cs];
    return a;
}
/* The reverse: the least value of each channel. */
REC_INLINE rec_f4 least_of(vf v, size_t cs)
{
    rec_f4 low = rec_splat(INFINITY);
    for (size_t l = 0; l < VEC; l++)
        low[l % cs] = v[l] < low[l % cs] ? v[l] : low[l % cs];
    return low;
}

/* ---- pixels to b ---- */

/* The lanes that bin (x,y) measures. */
REC_INLINE rec_i4 measured(const struct rec_photo_image *im, int32_t x, int32_t y, size_t cs,
                           bool mosaic)
{
    const rec_i4 all = {-1, cs == 4 ? -1 : 0, cs == 4 ? -1 : 0, 0};
    return mosaic ? rec_mosaic_lane(im->cell, x, y) : all;
}

/* The same as masks for the floats of even and odd rows. */
struct lanes {
    int32_t of[2][8];
};
REC_INLINE struct lanes lanes_of(const struct rec_photo_image *im, size_t cs, bool mosaic)
{
    struct lanes l;
    for (size_t y = 0; y < 2; y++)
        for (size_t j = 0; j < 8; j++)
            l.of[y][j] = measured(im, (int32_t)(j / cs), (int32_t)y, cs, mosaic)[j % cs];
    return l;
}
REC_INLINE vi lanes_at(const struct lanes *l, size_t y, size_t j)
{
    return *(const vi *)(l->of[y % 2] + j % 8);
}

/* Constants of (1). */
struct tone {
    rec_f4 full, black, scale;
    vf fulls, blacks, scales, most, none; /* the same, repeated; LIMIT; INF */
    struct lanes lanes;
};

/* One bin of any kind. */
REC_INLINE void linear_bin(const struct rec_photo_image *im, int32_t x, int32_t y,
                           const struct tone *t, struct rec_photo_band *out, size_t cs, bool mosaic)
{
    const rec_f4 zero = {0}, most = rec_splat(LIMIT);
    const rec_i4 lanes = measured(im, x, y, cs, mosaic);
    size_t i = (size_t)y * (size_t)im->bw + (size_t)x;
    rec_f4 v = rec_select(lanes, rec_ld(im->img, i, cs), zero); /* other lanes: anything */
    bool saturated = rec_any((v >= t->full) & lanes);
    v -= t->black;
    if (im->background != NULL)
        v -= rec_ld(im->background, i, cs);
    v *= t->scale;
    bool bad = rec_any(~((v <= most) & (v >= -most)) & lanes); /* NaN too */
    v = rec_select(lanes, bad ? zero : v, zero);
    rec_st(im->img, i, cs, v);
    out->not_finite += bad;
    out->saturated += !bad && saturated;
    im->weight[i] = !bad && !saturated;
    im->work->raw[i] = bad || saturated ? REC_FORCED : REC_UNLIT;
    if (!bad && !saturated)
        out->low = rec_select((v < out->low) & lanes, v, out->low);
}

/* GROUP floats of row y from bin x on.  False, and nothing done: some are saturated or unsound (NaN, over LIMIT). */
REC_INLINE bool linear_group(const struct rec_photo_image *im, int32_t x, int32_t y,
                             const struct tone *t, vf *low, size_t cs, bool mosaic)
{
    size_t i = (size_t)y * (size_t)im->bw + (size_t)x;
    float *img = im->img + i * cs;
    vf v[GROUP / VEC];
    vi odd = {0}, sound = ~odd;
    for (size_t k = 0; k < GROUP / VEC; k++) {
        vi mask = lanes_at(&t->lanes, (size_t)y, k * VEC);
        vf a = load(img + k * VEC);
        a = cs == 4 ? (vf)((vi)a & mask) : a;
        odd |= a >= t->fulls;
        a -= t->blacks;
        if (im->background != NULL)
            a -= load(im->background + i * cs + k * VEC);
        a *= t->scales;
        a = cs == 4 ? (vf)((vi)a & mask) : a;
        sound &= (vf)((vi)a & INT32_MAX) <= t->most; /* false for NaN */
        v[k] = a;
    }
    if (any(odd | ~sound))
        return false;
    for (size_t k = 0; k < GROUP / VEC; k++) {
        vi mask = lanes_at(&t->lanes, (size_t)y, k * VEC);
        store(img + k * VEC, v[k]);
        *low = least(mosaic ? pick(mask, v[k], t->none) : v[k], *low);
    }
    for (size_t k = 0; k < GROUP / cs; k++)
        im->weight[i + k] = 1;
    memset(im->work->raw + i, REC_UNLIT, GROUP / cs);
    return true;
}

/* ---- noise ---- */

/* Sums over a block, and the numbers of their terms.  They run down the columns first, then across: so the columns
 * are lanes if there is one channel, and independent sums if there are more. */
struct sums {
    rec_f4 value, diff2, low, at_low;
    rec_f4 bins, cells;
};

REC_INLINE rec_f4 ones(rec_i4 lanes)
{
    return rec_select(lanes, rec_splat(1), (rec_f4){0});
}

/* Any block: cut by the image's edge, or with some bins without weight. */
REC_INLINE void sum_block(const struct rec_photo_image *im, int32_t x0, int32_t y0, int32_t step,
                          struct sums *s, size_t cs, bool mosaic)
{
    const float *img = im->img, *weight = im->weight;
    int32_t bw = im->bw, bh = im->bh;
    int32_t x1 = x0 + BLOCK < bw ? x0 + BLOCK : bw, y1 = y0 + BLOCK < bh ? y0 + BLOCK : bh;
    for (int32_t x = x0; x < x1; x++) {
        rec_f4 value = {0}, diff2 = {0};
        for (int32_t y = y0; y < y1; y++) {
            size_t k = (size_t)step, i = (size_t)y * (size_t)bw + (size_t)x, j = i + k * (size_t)bw;
            rec_i4 lanes = measured(im, x, y, cs, mosaic);
            if (weight[i] == 0)
                continue;
            rec_f4 a = rec_ld(img, i, cs);
            value += a;
            s->at_low += ones((a == s->low) & lanes);
            s->at_low = rec_select((a < s->low) & lanes, rec_splat(1), s->at_low);
            s->low = rec_select((a < s->low) & lanes, a, s->low);
            s->bins += ones(lanes);
            if (x + step >= x1 || y + step >= y1 || weight[i + k] == 0 || weight[j] == 0 ||
                weight[j + k] == 0)
                continue;
            rec_f4 d = (a - rec_ld(img, i + k, cs)) - (rec_ld(img, j, cs) - rec_ld(img, j + k, cs));
            diff2 += d * d;
            s->cells += ones(lanes);
        }
        s->value += value;
        s->diff2 += diff2;
    }
}

/* A block whose bins all exist and have weight; the `step` columns to its right exist too. */
REC_INLINE void sum_whole_block(const struct rec_photo_image *im, int32_t x0, int32_t y0,
                                int32_t step, struct sums *s, size_t cs, bool mosaic)
{
    const size_t row = (size_t)im->bw * cs, n = BLOCK * cs, right = (size_t)step * cs;
    const size_t down = (size_t)step * row;
    const float *img = im->img + ((size_t)y0 * (size_t)im->bw + (size_t)x0) * cs;
    const vf none = repeat(rec_splat(INFINITY), cs);
    _Alignas(16) float value[4 * BLOCK], diff2[4 * BLOCK], at_low[4 * BLOCK];
    struct lanes lanes = lanes_of(im, cs, mosaic);
    vf low = none;
    for (size_t j = 0; j < n; j += VEC) {
        vf sum = {0}, sum2 = {0};
        for (size_t y = 0; y < BLOCK; y++) {
            const float *v = img + y * row + j;
            vf a = load(v);
            sum += a;
            low = least(mosaic ? pick(lanes_at(&lanes, y, j), a, none) : a, low);
            if (y + (size_t)step >= BLOCK)
                continue;
            vf d = (a - load(v + right)) - (load(v + down) - load(v + down + right));
            sum2 += d * d;
        }
        store(value + j, sum);
        store(diff2 + j, sum2);
    }
    s->low = least_of(low, cs);
    low = repeat(s->low, cs);
    for (size_t j = 0; j < n; j += VEC) {
        vi count = {0};
        for (size_t y = 0; y < BLOCK; y++)
            count -=
                (load(img + y * row + j) == low) & (mosaic ? lanes_at(&lanes, y, j) : ~(vi){0});
        store(at_low + j, __builtin_convertvector(count, vf));
    }
    for (size_t x = 0; x < BLOCK; x++) {
        s->value += rec_ld(value, x, cs);
        s->at_low += rec_ld(at_low, x, cs);
        if (x + (size_t)step < BLOCK)
            s->diff2 += rec_ld(diff2, x, cs);
    }
    for (int32_t k = 0; k < 4; k++) { /* a quarter of the bins, and of the differences */
        rec_f4 one = ones(measured(im, k % 2, k / 2, cs, mosaic));
        s->bins += rec_splat(BLOCK * BLOCK / 4) * one;
        s->cells += rec_splat((float)((BLOCK - step) * (BLOCK - step)) / 4) * one;
    }
}

REC_INLINE bool whole(const struct rec_photo_image *im, int32_t x0, int32_t y0, int32_t step)
{
    if (x0 + BLOCK + step > im->bw || y0 + BLOCK > im->bh)
        return false;
    const float *weight = im->weight + (size_t)y0 * (size_t)im->bw + (size_t)x0;
    vi gone = {0};
    for (size_t y = 0; y < BLOCK; y++)
        for (size_t x = 0; x < BLOCK; x += VEC)
            gone |= load(weight + y * (size_t)im->bw + x) == 0;
    return !any(gone);
}

/* The mixed second difference a-b-c+d of 2x2 bins is blind to any linear slope, and its variance is 4 sigma^2 for
 * independent noise.  The four bins are the grain's step apart.  Sums have at most 64 terms, so float is precise
 * enough. */
REC_INLINE void measure_block(const struct rec_photo_image *im, int32_t x0, int32_t y0,
                              struct rec_photo_block *out, size_t cs, bool mosaic)
{
    const int32_t step = im->work->grain.step;
    struct sums s = {.low = rec_splat(INFINITY)};
    if (whole(im, x0, y0, step))
        sum_whole_block(im, x0, y0, step, &s, cs, mosaic);
    else
        sum_block(im, x0, y0, step, &s, cs, mosaic);
    out->measured = true;
    for (int c = 0; c < im->nch; c++)
        out->measured = out->measured && s.cells[c] >= 4;
    if (!out->measured)
        return;
    out->mean = s.value / s.bins;
    out->noise2 = s.diff2 / (rec_splat(4) * s.cells);
    out->low = s.low;
    out->at_low = s.at_low / s.bins;
}

REC_INLINE void linear(const struct rec_photo_image *image, int32_t b, size_t cs, bool mosaic)
{
    const struct rec_photo_image own = *image, *im = &own; /* a copy that no store can change */
    const struct rec_photo_params *p = im->params;
    const float *g = im->gain;
    struct tone t = {
        .full = rec_splat(p->saturation < 0 ? REC_PHOTO_FULL : p->saturation),
        .black = rec_splat(p->black),
        .scale = cs == 4 ? (rec_f4){g[0], g[1], g[2], 0} : rec_splat(g[0]),
        .most = repeat(rec_splat(LIMIT), cs),
        .none = repeat(rec_splat(INFINITY), cs),
        .lanes = lanes_of(im, cs, mosaic),
    };
    t.fulls = repeat(t.full, cs);
    t.blacks = repeat(t.black, cs);
    t.scales = repeat(t.scale, cs);
    struct rec_photo_band out = {.low = rec_splat(INFINITY)};
    vf low = repeat(out.low, cs);
    int32_t y0, y1, group = (int32_t)(GROUP / cs);
    rec_band_rows(b, im->bh, &y0, &y1);
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = 0; x < im->bw; x += group) {
            if (x + group <= im->bw && linear_group(im, x, y, &t, &low, cs, mosaic))
                continue;
            for (int32_t u = x; u < im->bw && u < x + group; u++)
                linear_bin(im, u, y, &t, &out, cs, mosaic);
        }
    rec_f4 grouped = least_of(low, cs);
    out.low = rec_select(grouped < out.low, grouped, out.low);
    im->work->band[b] = out;

    const struct rec_photo_blocks all = rec_photo_blocks(im);
    int32_t from = y0 / BLOCK * all.across, to = (y1 + BLOCK - 1) / BLOCK * all.across;
    for (int32_t m = (from + all.every - 1) / all.every; m * all.every < to; m++) {
        int32_t k = m * all.every;
        measure_block(im, k % all.across * BLOCK, k / all.across * BLOCK, &im->work->block[m], cs,
                      mosaic);
    }
}
static void linear_band(const struct rec_photo_image *im, int32_t b)
{
    FOR_KIND(im, linear, im, b);
}

/* The k-th smallest of v [n], found bit by bit from the highest, on integers that are ordered as the floats are.  No
 * NaN. */
static float select_kth(const float *v, int32_t n, int32_t k)
{
    enum { STEP = 4 * VEC };
    int32_t key[REC_PHOTO_BLOCKS + STEP], found = INT32_MIN;
    float out;
    for (int32_t i = 0; i < n; i++) {
        int32_t bits;
        memcpy(&bits, v + i, sizeof bits);
        key[i] = bits ^ (bits >> 31 & INT32_MAX);
    }
    for (int32_t i = n; i % STEP != 0; i++)
        key[i] = INT32_MAX;
    for (uint32_t bit = 1u << 31; bit != 0; bit >>= 1) {
        const int32_t more = (int32_t)((uint32_t)found ^ bit);
        vi few[4] = {{0}};
        for (int32_t i = 0; i < n; i += STEP)
            for (int32_t u = 0; u < 4; u++)
                few[u] += *(const vi *)(key + i + u * VEC) < more;
        few[0] += few[1] + few[2] + few[3];
        int32_t below = 0;
        for (int l = 0; l < VEC; l++)
            below -= few[0][l];
        found = below <= k ? more : found;
    }
    found ^= found >> 31 & INT32_MAX;
    memcpy(&out, &found, sizeof out);
    return out;
}

/* Sigma: the median over the darker half of the blocks.  A camera that clips at black keeps only the upper half of
 * the background's noise.  Its blocks are then about half filled with the lowest value, and max(0, N(0,s)) has the
 * standard deviation 0.5838 s.
 * Dark: the lower quartile of the blocks' means, the level that a background clipped at 0 keeps. */
static void noise(const struct rec_photo_image *im, int32_t c)
{
    struct rec_photo_work *w = im->work;
    const struct rec_photo_blocks all = rec_photo_blocks(im);
    float mean[REC_PHOTO_BLOCKS], noise2[REC_PHOTO_BLOCKS], at_low[REC_PHOTO_BLOCKS];
    float low = INFINITY;
    int32_t n = 0, half = 0;
    for (size_t b = 0; b < rec_band_count(im->bh); b++)
        low = fminf(low, w->band[b].low[c]);
    for (int32_t m = 0; m * all.every < all.all; m++) {
        const struct rec_photo_block *b = &w->block[m];
        if (!b->measured)
            continue;
        mean[n] = b->mean[c];
        noise2[n] = b->noise2[c];
        at_low[n++] = b->at_low[c] * (float)(b->low[c] <= low);
    }
    w->sigma[c] = w->dark[c] = 0;
    w->half[c] = (struct rec_photo_dark){.low = low};
    if (n == 0)
        return;
    float limit = select_kth(mean, n, n / 2);
    w->half[c].mean = select_kth(mean, n, n / 4);
    w->dark[c] = fmaxf(0, w->half[c].mean);
    for (int32_t i = 0; i < n; i++) { /* no branch: it could not be predicted */
        noise2[half] = noise2[i];
        at_low[half] = at_low[i];
        half += mean[i] <= limit;
    }
    w->half[c].noise2 = select_kth(noise2, half, half / 2);
    float s = sqrtf(w->half[c].noise2), z = select_kth(at_low, half, half / 2);
    w->half[c].at_low = z;
    w->sigma[c] = z > 0.25f && z < 0.75f ? s / 0.5838f : s;
}

/* ---- silhouettes ---- */

/* The limits for bins and means in one pass over a picture. */
struct test {
    const float *img, *plane; /* their bins that reach `limit` are lit; NULL: none */
    vf limit;
    int32_t side;
    vf mean_limit, cap; /* for sums over side x side bins of `pic`; a bin counts at most cap */
    const float *pic;
};

/* Equation (2) of photo.h, mirrored at the border. */
static void plane_band(const struct rec_photo_image *im, int32_t b)
{
    const vf scale = repeat((rec_f4){4.0f / 16, 2.0f / 16, 4.0f / 16, 0}, 4);
    const size_t wide = (size_t)im->bw * 4;
    float sums[CHUNK + 8]; /* over three rows, from the bin before to the bin after */
    int32_t y0, y1;
    rec_band_rows(b, im->bh, &y0, &y1);
    for (int32_t y = y0; y < y1; y++) {
        const float *mid = im->img + (size_t)y * wide;
        const float *up = im->img + (size_t)(y > 0 ? y - 1 : 1) * wide;
        const float *down = im->img + (size_t)(y + 1 < im->bh ? y + 1 : im->bh - 2) * wide;
        float *out = im->plane + (size_t)y * wide;
        for (size_t f = 0; f < wide; f += CHUNK) {
            size_t n = f + CHUNK < wide ? CHUNK : wide - f;
            size_t lo = f > 0 ? f - 4 : 0, hi = f + n < wide ? f + n + 4 : wide;
            float *sum = sums + 4, *end = sum + n;
            for (size_t i = lo; i < hi; i++)
                sum[i - f] = up[i] + 2 * mid[i] + down[i];
            if (f == 0)
                memcpy(sums, sum + 4, 4 * sizeof *sums);
            if (f + n == wide)
                memcpy(end, end - 8, 4 * sizeof *sums);
            size_t j = 0;
            for (; j + VEC <= n; j += VEC)
                store(out + f + j,
                      scale * (load(sums + j) + 2 * load(sum + j) + load(sum + j + 4)));
            for (; j < n; j++)
                out[f + j] = scale[j % 4] * (sums[j] + 2 * sum[j] + sum[j + 4]);
        }
    }
}

/* Sums over `side` rows around y, each bin at most `cap`, for n floats from f on and for those on both sides that
 * means reach.  Beyond the image -INF, so that a mean that needs such floats reaches no limit. */
REC_INLINE void add_rows(const struct test *t, size_t wide, int32_t y, size_t f, size_t n,
                         float *sums, size_t cs)
{
    const size_t reach = (size_t)(t->side / 2) * cs;
    const float *top = t->pic + (size_t)(y - t->side / 2) * wide;
    size_t lo = f > reach ? f - reach : 0, hi = f + n + reach < wide ? f + n + reach : wide, i;
    float *out = sums + reach; /* sum of float f */
    for (i = 0; i < reach - (f - lo); i++)
        sums[i] = -INFINITY;
    for (i = hi - f; i < n + reach; i++)
        out[i] = -INFINITY;
    out -= f;
    for (i = lo; i + VEC <= hi; i += VEC) {
        vf s = least(load(top + i), t->cap);
        for (size_t v = 1; v < (size_t)t->side; v++)
            s += least(load(top + v * wide + i), t->cap);
        store(out + i, s);
    }
    for (; i < hi; i++) {
        float cap = t->cap[i % cs], s = top[i] < cap ? top[i] : cap;
        for (size_t v = 1; v < (size_t)t->side; v++) {
            float a = top[v * wide + i];
            s += a < cap ? a : cap;
        }
        out[i] = s;
    }
}

/* Tests m floats at f, with their sums if there are any; hit[] gets masks.  Returns whether any is hit. */
REC_INLINE bool test_group(const struct test *t, const float *sums, size_t f, size_t m,
                           int32_t hit[GROUP], size_t cs)
{
    vi some = {0};
    size_t j = 0;
    for (; j + VEC <= m; j += VEC) {
        vi h = {0};
        if (t->img != NULL)
            h |= load(t->img + f + j) >= t->limit;
        if (t->plane != NULL)
            h |= load(t->plane + f + j) >= t->limit;
        if (sums != NULL) {
            vf s = load(sums + j);
            for (size_t u = 1; u < (size_t)t->side; u++)
                s += load(sums + j + u * cs);
            h |= s >= t->mean_limit;
        }
        *(vi *)(hit + j) = h;
        some |= h;
    }
    bool rest = false;
    for (; j < m; j++) {
        bool h = (t->img != NULL && t->img[f + j] >= t->limit[j % cs]) ||
                 (t->plane != NULL && t->plane[f + j] >= t->limit[j % cs]);
        if (sums != NULL) {
            float s = sums[j];
            for (size_t u = 1; u < (size_t)t->side; u++)
                s += sums[j + u * cs];
            h |= s >= t->mean_limit[j % cs];
        }
        hit[j] = -(int32_t)h;
        rest |= h;
    }
    return rest || any(some);
}

/* Lights the bins of row y that `t` finds, with means or without, and adds them up. */
REC_INLINE void light_row(const struct rec_photo_image *im, const struct test *t, int32_t y,
                          bool means, rec_d4 *sum, uint32_t *hits, size_t cs)
{
    const size_t wide = (size_t)im->bw * cs, row = (size_t)y * (size_t)im->bw;
    _Alignas(32) float sums[CHUNK + 2 * 3 * 4];
    _Alignas(32) int32_t hit[GROUP];
    for (size_t f = 0; f < wide; f += CHUNK) {
        size_t n = f + CHUNK < wide ? CHUNK : wide - f;
        if (means)
            add_rows(t, wide, y, f, n, sums, cs);
        for (size_t g = 0; g < n; g += GROUP) {
            size_t m = g + GROUP < n ? GROUP : n - g, i = row + (f + g) / cs;
            if (!test_group(t, means ? sums + g : NULL, row * cs + f + g, m, hit, cs))
                continue;
            for (size_t k = 0; k < m / cs; k++)
                if (cs == 4 ? rec_any(*(const rec_i4 *)(hit + 4 * k)) : hit[k] != 0) {
                    im->work->raw[i + k] |= REC_LIT;
                    rec_add_product(sum, rec_ld(t->pic, i + k, cs), rec_splat(1));
                    ++*hits;
                }
        }
    }
}

/* Means over squares of `side` bins (odd) that reach a limit find faint edges.  A mean has 1/side of the noise, so
 * its limit may be as much lower, above the level of the dark blocks (noise clipped at 0 has a positive mean).  A bin
 * counts at most `cap`, so that a hot pixel does not light its neighbours.  Bins nearer to the image's border than
 * side/2 have no such mean. */
REC_INLINE void judge(const struct rec_photo_image *im, int32_t b, size_t cs, bool mosaic)
{
    struct rec_photo_work *w = im->work;
    const struct test t = {
        .img = im->img,
        .plane = mosaic ? im->plane : NULL,
        .limit = repeat(w->limit, cs),
        .side = 3,
        .mean_limit = repeat(w->faint * rec_splat(9), cs),
        .cap = repeat(w->limit + w->limit, cs),
        .pic = mosaic ? im->plane : im->img,
    };
    rec_d4 sum = {0};
    uint32_t hits = 0;
    int32_t y0, y1;
    rec_band_rows(b, im->bh, &y0, &y1);
    for (int32_t y = y0; y < y1; y++)
        light_row(im, &t, y, w->means && y >= 1 && y + 1 < im->bh, &sum, &hits, cs);
    rec_put(w->band[b].sum, &sum);
    w->band[b].hits = hits;
}
static void judge_band(const struct rec_photo_image *im, int32_t b)
{
    FOR_KIND(im, judge, im, b);
}

REC_INLINE void widen(const struct rec_photo_image *im, int32_t b, size_t cs, bool mosaic)
{
    const rec_f4 limit = im->work->fainter;
    const struct test t = {
        .side = 7,
        .mean_limit = repeat(limit * rec_splat(49), cs),
        .cap = repeat(rec_splat(4) * limit, cs),
        .pic = mosaic ? im->plane : im->img,
    };
    rec_d4 sum = {0};
    uint32_t hits = 0;
    int32_t y0, y1;
    rec_band_rows(b, im->bh, &y0, &y1);
    for (int32_t y = y0 > 3 ? y0 : 3; y < y1 && y + 3 < im->bh; y++)
        light_row(im, &t, y, true, &sum, &hits, cs);
}
static void widen_band(const struct rec_photo_image *im, int32_t b)
{
    FOR_KIND(im, widen, im, b);
}

/* Bins with fewer than two lit neighbours become unlit; outside the image counts as unlit.  Rows are summed over
 * three in bytes, which compilers turn into vectors. */
static void finish(const struct rec_photo_image *im, int32_t b, bool despeckle, uint8_t *out)
{
    const size_t w = (size_t)im->bw;
    uint8_t sums[CHUNK + 2];
    uint32_t lit = 0;
    int32_t y0, y1;
    rec_band_rows(b, im->bh, &y0, &y1);
    for (int32_t y = y0; y < y1; y++) {
        const uint8_t *row = im->work->raw + (size_t)y * w, *above = y > 0 ? row - w : NULL;
        const uint8_t *below = y + 1 < im->bh ? row + w : NULL;
        for (size_t f = 0; f < w; f += CHUNK) {
            size_t n = f + CHUNK < w ? CHUNK : w - f;
            size_t lo = f > 0 ? f - 1 : 0, hi = f + n < w ? f + n + 1 : w; /* that are summed */
            const uint8_t *in = row + f;
            uint8_t *to = out + (size_t)y * w + f, *sum = sums + 1 - f;
            sums[0] = sums[n + 1] = 0;
            for (size_t x = lo; x < hi; x++)
                sum[x] = row[x] != REC_UNLIT;
            for (size_t x = lo; above != NULL && x < hi; x++)
                sum[x] = (uint8_t)(sum[x] + (above[x] != REC_UNLIT));
            for (size_t x = lo; below != NULL && x < hi; x++)
                sum[x] = (uint8_t)(sum[x] + (below[x] != REC_UNLIT));
            for (size_t x = 0; x < n; x++) {
                uint8_t lone = (uint8_t)(sums[x] + sums[x + 1] + sums[x + 2]) < 3 && despeckle;
                to[x] = in[x] != REC_UNLIT && !(in[x] == REC_LIT && lone); /* forced stays */
                lit += to[x];
            }
        }
    }
    im->work->band[b].lit = lit;
}

void PASSES(struct rec_photo_passes *p)
{
    *p = (struct rec_photo_passes){
        .linear = linear_band,
        .noise = noise,
        .plane = plane_band,
        .judge = judge_band,
        .widen = widen_band,
        .finish = finish,
    };
}
