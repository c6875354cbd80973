/* pixfmt_mosaic.c - Bayer images at even binning b.
 *
 * Green: the bin's own samples, whose centre of gravity is the bin's.  Red's and blue's would be half a
 * pixel off, so each of their samples counts as far as the 2x2 pixels that it stands for lie in the bin:
 * along each axis, in half pixels, 4 inside, 3 for the sample at the bin's edge and 1 for the next one
 * beyond the other edge,
 *     weighted sum = 4 (sum of the bin's own) - the one at the edge + the one beyond                (1)
 * with weights (2b)^2 in all.  Down the rows first, for all columns, then across. */
#include <string.h>

#include "capture/pixfmt_fast.h"

enum { PIECE = 512 }; /* pixels at a time, and one more on each side */
enum { ROOM = PIECE + CAP_PIX_SLACK };

/* Pixels x-1 .. x+n of one row: values to be added, and the samples. */
struct line {
    uint32_t v[ROOM + 2];
    uint16_t top[ROOM + 2];
};
/* Sums down the rows of one parity and greatest samples: own rows of the bin, and (1). */
struct columns {
    uint32_t sum[PIECE + 2], sum1[PIECE + 2];
    uint16_t top[PIECE + 2], top1[PIECE + 2];
};
/* Bins: sums and greatest samples per channel. */
struct bins {
    uint32_t sum[3][PIECE / 2 + CAP_PIX_SLACK];
    uint16_t top[3][PIECE / 2 + CAP_PIX_SLACK];
};

CAP_PIX_INLINE uint16_t greater(uint16_t a, uint16_t b)
{
    return a > b ? a : b;
}

static void one_value(const struct cap_pix *j, int32_t x, int32_t y, int32_t at, struct line *l)
{
    unsigned v = cap_pix_sample(j, x, y, 0);
    v = v < j->full ? v : j->full;
    l->top[at] = (uint16_t)v;
    l->v[at] = j->table == NULL ? v : j->table[v];
}

static void take(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, struct line *restrict l)
{
    const uint32_t *table = j->table;
    int32_t w = j->img.width, h = j->img.height;
    y = y < 0 ? -y : y >= h ? 2 * h - 2 - y : y;
    CAP_PIX(row)(j, y, x, n, l->top + 1, 0);
    if (table == NULL)
        for (int32_t i = 1; i <= n; i++)
            l->v[i] = l->top[i];
    else
        for (int32_t i = 1; i <= n; i++)
            l->v[i] = table[l->top[i]];
    one_value(j, x > 0 ? x - 1 : 1, y, 0, l);
    one_value(j, x + n < w ? x + n : w - 2, y, n + 1, l);
}

static void add_line(const struct line *restrict l, int32_t n, struct columns *restrict c)
{
    for (int32_t i = 0; i < n; i++)
        c->sum[i] += l->v[i];
    for (int32_t i = 0; i < n; i++)
        c->top[i] = greater(c->top[i], l->top[i]);
}

/* Sums down the rows of one parity of a bin: at its edge, `beyond` the other one, and from row y on those
 * between. */
static void down(const struct cap_pix *j, const struct line *restrict edge,
                 const struct line *restrict beyond, int32_t y, int32_t x, int32_t n,
                 struct columns *restrict c)
{
    struct line l;
    memcpy(c->sum, edge->v, (size_t)(n + 2) * sizeof c->sum[0]);
    memcpy(c->top, edge->top, (size_t)(n + 2) * sizeof c->top[0]);
    for (int r = 1; r < j->binning / 2; r++) {
        take(j, y + 2 * (r - 1), x, n, &l);
        add_line(&l, n + 2, c);
    }
    for (int32_t i = 0; i < n + 2; i++)
        c->sum1[i] = 4 * c->sum[i] - edge->v[i] + beyond->v[i];
    for (int32_t i = 0; i < n + 2; i++)
        c->top1[i] = greater(c->top[i], beyond->top[i]);
}

/* (1) along the row for red or blue at the columns of parity q. */
CAP_PIX_INLINE void across_one(const struct columns *c, int b, int q, int32_t bins,
                               uint32_t *restrict sum, uint16_t *restrict top)
{
    const int32_t edge = q == 0 ? 0 : b - 1, beyond = q == 0 ? b : -1;
    const uint32_t *restrict v = c->sum1 + 1;
    const uint16_t *restrict m = c->top1 + 1;
    for (int32_t X = 0; X < bins; X++) {
        uint32_t s = 0;
        for (int i = q; i < b; i += 2)
            s += v[X * b + i];
        sum[X] = 4 * s - v[X * b + edge] + v[X * b + beyond];
    }
    for (int32_t X = 0; X < bins; X++) {
        uint16_t t = m[X * b + beyond];
        for (int i = q; i < b; i += 2)
            t = greater(t, m[X * b + i]);
        top[X] = t;
    }
}

/* Green, at the columns of parity q of this row's and 1-q of the other's. */
CAP_PIX_INLINE void across_green(const struct columns *restrict c0,
                                 const struct columns *restrict c1, int b, int q, int32_t bins,
                                 uint32_t *restrict sum, uint16_t *restrict top)
{
    for (int32_t X = 0; X < bins; X++) {
        uint32_t s = 0;
        for (int i = 0; i < b; i += 2)
            s += c0->sum[1 + X * b + i + q] + c1->sum[1 + X * b + i + 1 - q];
        sum[X] = s;
    }
    for (int32_t X = 0; X < bins; X++) {
        uint16_t t = 0;
        for (int i = 0; i < b; i += 2)
            t = greater(t, greater(c0->top[1 + X * b + i + q], c1->top[1 + X * b + i + 1 - q]));
        top[X] = t;
    }
}

CAP_PIX_INLINE void across(const struct cap_pix *j, const struct columns c[2], int b, int32_t bins,
                           struct bins *out)
{
    /* where the rows' own colours are; a green pixel comes first in the other case */
    const uint8_t *at = j->cell;
    if (at[0] != 1) {
        across_one(&c[0], b, 0, bins, out->sum[at[0]], out->top[at[0]]);
        across_one(&c[1], b, 1, bins, out->sum[at[3]], out->top[at[3]]);
        across_green(&c[0], &c[1], b, 1, bins, out->sum[1], out->top[1]);
    } else {
        across_one(&c[0], b, 1, bins, out->sum[at[1]], out->top[at[1]]);
        across_one(&c[1], b, 0, bins, out->sum[at[2]], out->top[at[2]]);
        across_green(&c[0], &c[1], b, 0, bins, out->sum[1], out->top[1]);
    }
}

static void put(const struct cap_pix *j, const struct bins *v, int32_t bins, float *out)
{
    const int b = j->binning;
    const float own = cap_pix_scale(j, 4 * b * b), green = cap_pix_scale(j, b * b / 2);
    const struct cap_pix_bins p = {
        {v->sum[0], v->sum[1], v->sum[2]},
        {v->top[0], v->top[1], v->top[2]},
        {{own, own}, {green, green}, {own, own}},
    };
    CAP_PIX(finish)(j, &p, bins, out);
}

/* One piece of a row of bins: first and last of its rows, the last of the bins above, the first of those
 * below. */
static void bins_of(const struct cap_pix *j, int32_t Y, int32_t x, int32_t n,
                    const struct line *first, const struct line *last, const struct line *above,
                    const struct line *below, float *out)
{
    struct columns c[2];
    struct bins v;
    int b = j->binning;
    int32_t bins = n / b;
    down(j, first, below, Y * b + 2, x, n, &c[0]);
    down(j, last, above, Y * b + 1, x, n, &c[1]);
    if (b == 2)
        across(j, c, 2, bins, &v);
    else if (b == 4)
        across(j, c, 4, bins, &v);
    else
        across(j, c, b, bins, &v);
    put(j, &v, bins, out);
}

void CAP_PIX(mosaic)(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    struct line line[4], *first = &line[0], *below = &line[1], *last = &line[2], *above = &line[3];
    int32_t b = j->binning, w = j->img.width, bw = w / b;
    int32_t unit = b % 4 == 0 ? b : 2 * b, piece = PIECE / unit * unit;
    for (int32_t x = 0; x < w && y0 < y1; x += piece) {
        int32_t n = w - x < piece ? w - x : piece;
        take(j, y0 * b, x, n, below);
        take(j, y0 * b - 1, x, n, last);
        for (int32_t Y = y0; Y < y1; Y++) { /* these two rows have been taken for the bins before */
            struct line *t = first;
            first = below;
            below = t;
            t = above;
            above = last;
            last = t;
            take(j, (Y + 1) * b, x, n, below);
            take(j, (Y + 1) * b - 1, x, n, last);
            bins_of(j, Y, x, n, first, last, above, below,
                    out + ((size_t)Y * (size_t)bw + (size_t)(x / b)) * (j->nch == 3 ? 4 : 1));
        }
    }
}
