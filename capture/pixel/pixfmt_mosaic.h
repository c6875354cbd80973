/* pixfmt_mosaic.h - Bayer images binned, binning b >= 2.
 *
 * Green: the bin's own samples, whose centre of gravity is the bin's, or nearly.  Red and blue would be half a
 * pixel off, so each of their samples counts as far as the 2x2 pixels that it stands for lie in the bin.  Its
 * weight along each axis, in half pixels: 4 inside, 3 at an edge of the bin, 1 just beyond an edge.  So
 *     weighted sum = 4 (sum of the bin's own) - those at the edges + those beyond                   (1)
 * and all weights together are (2b)^2.  At each edge, one of the two (at, beyond) has the colour.  The sums go down
 * the rows first, for all columns, then across. */
#ifndef CAP_PIXFMT_MOSAIC_H
#define CAP_PIXFMT_MOSAIC_H
#include "capture/pixel/pixfmt_finish.h"
#include "capture/pixel/pixfmt_unpack.h"

/* Sums down the rows of one parity, and greatest samples: of the bin's own rows, and (1) in sum1, top1. */
struct columns {
    uint32_t sum[CAP_PIX_PIECE + 2], sum1[CAP_PIX_PIECE + 2];
    uint16_t top[CAP_PIX_PIECE + 2], top1[CAP_PIX_PIECE + 2];
};
/* Bins: sums and greatest samples per channel. */
struct bins {
    uint32_t sum[3][CAP_PIX_PIECE / 2 + CAP_PIX_SLACK];
    uint16_t top[3][CAP_PIX_PIECE / 2 + CAP_PIX_SLACK];
};

static void add_line(const struct cap_pix_line *restrict l, int32_t n, struct columns *restrict c)
{
    for (int32_t i = 0; i < n; i++)
        c->sum[i] += l->v[i];
    for (int32_t i = 0; i < n; i++)
        c->top[i] = cap_pix_greater(c->top[i], l->top[i]);
}

/* Add the line to c, or (first) set c to it. */
static void own(const struct cap_pix_line *restrict l, int32_t n, bool first,
                struct columns *restrict c)
{
    if (first) {
        memcpy(c->sum, l->v, (size_t)n * sizeof c->sum[0]);
        memcpy(c->top, l->top, (size_t)n * sizeof c->top[0]);
    } else {
        add_line(l, n, c);
    }
}

/* (1) down the rows.  The row at each edge is the bin's own, or (beyond_lo, beyond_hi) the one just beyond it. */
static void pixel_weigh(const struct cap_pix_line *restrict lo, bool beyond_lo,
                        const struct cap_pix_line *restrict hi, bool beyond_hi, int32_t n,
                        struct columns *restrict c)
{
    const uint32_t a = beyond_lo ? 0 : ~0u, b = beyond_hi ? 0 : ~0u; /* (v ^ ~0) - ~0 = -v */
    for (int32_t i = 0; i < n; i++)
        c->sum1[i] = 4 * c->sum[i] + ((lo->v[i] ^ a) - a) + ((hi->v[i] ^ b) - b);
    for (int32_t i = 0; i < n; i++)
        c->top1[i] = cap_pix_greater(c->top[i], cap_pix_greater(lo->top[i], hi->top[i]));
}

/* Pixel rows at the edges of a row of bins: the last row of the bins above, the bins' own first and last row, the
 * first row of the bins below. */
struct edges {
    struct cap_pix_line *above, *first, *last, *below;
};

/* Sums down the rows of bins Y: even rows in c[0], odd rows in c[1]. */
static void pixel_down(const struct cap_pix *j, int32_t Y, int32_t x, int32_t n,
                       const struct edges *e, struct columns c[2])
{
    struct cap_pix_line l;
    const int b = j->binning, p = (Y * b) & 1, q = (p + b - 1) & 1; /* parities of first and last */
    own(e->first, n + 2, true, &c[p]);
    for (int r = 1; r < b - 1; r++) {
        cap_pix_fetch(j, Y * b + r, x, n, &l);
        own(&l, n + 2, r == 1, &c[(p + r) & 1]);
    }
    own(e->last, n + 2, b == 2, &c[q]);
    for (int k = 0; k < 2; k++)
        pixel_weigh(p == k ? e->first : e->above, p != k, q == k ? e->last : e->below, q != k,
                    n + 2, &c[k]);
}

/* (1) along the row for red or blue, every step-th bin from `first` on.  In these bins the colour has the columns
 * of parity p.  b, p and step are constants after inlining.
 * NOLINTNEXTLINE(readability-function-size) */
CAP_PIX_INLINE void some(const struct columns *c, int b, int p, int32_t first, int32_t step,
                         int32_t bins, uint32_t *restrict sum, uint16_t *restrict top)
{
    const int last = (b - 1 - p) & 1; /* right edge: 0 = the bin's own column, 1 = the one beyond */
    for (int32_t X = first; X < bins; X += step) {
        const uint32_t *v = c->sum1 + 1 + (ptrdiff_t)X * b;
        uint32_t s = 0;
        for (int i = p; i < b; i += 2)
            s += v[i];
        s = 4 * s + (p == 0 ? 0 - v[0] : v[-1]);
        sum[X] = s + (last == 0 ? 0 - v[b - 1] : v[b]);
    }
    for (int32_t X = first; X < bins; X += step) {
        const uint16_t *m = c->top1 + 1 + (ptrdiff_t)X * b;
        uint16_t t = cap_pix_greater(m[-p], m[b - 1 + last]);
        for (int i = p; i < b; i += 2)
            t = cap_pix_greater(t, m[i]);
        top[X] = t;
    }
}

/* Green, otherwise as `some`: in these bins the columns of parity p of rows c0, and of parity 1-p of rows c1.
 * NOLINTNEXTLINE(readability-function-size) */
CAP_PIX_INLINE void some_green(const struct columns *c0, const struct columns *c1, int b, int p,
                               int32_t first, int32_t step, int32_t bins, uint32_t *restrict sum,
                               uint16_t *restrict top)
{
    for (int32_t X = first; X < bins; X += step) {
        const uint32_t *v0 = c0->sum + 1 + (ptrdiff_t)X * b, *v1 = c1->sum + 1 + (ptrdiff_t)X * b;
        uint32_t s = 0;
        for (int i = p; i < b; i += 2)
            s += v0[i];
        for (int i = 1 - p; i < b; i += 2)
            s += v1[i];
        sum[X] = s;
    }
    for (int32_t X = first; X < bins; X += step) {
        const uint16_t *m0 = c0->top + 1 + (ptrdiff_t)X * b, *m1 = c1->top + 1 + (ptrdiff_t)X * b;
        uint16_t t = 0;
        for (int i = p; i < b; i += 2)
            t = cap_pix_greater(t, m0[i]);
        for (int i = 1 - p; i < b; i += 2)
            t = cap_pix_greater(t, m1[i]);
        top[X] = t;
    }
}

/* All bins.  With odd b the parity alternates from bin to bin. */
CAP_PIX_INLINE void across_one(const struct columns *c, int b, int q, int32_t bins, uint32_t *sum,
                               uint16_t *top)
{
    if (b % 2 == 0) {
        some(c, b, q, 0, 1, bins, sum, top);
    } else {
        some(c, b, q, 0, 2, bins, sum, top);
        some(c, b, 1 - q, 1, 2, bins, sum, top);
    }
}

CAP_PIX_INLINE void across_green(const struct columns *c0, const struct columns *c1, int b, int q,
                                 int32_t bins, uint32_t *sum, uint16_t *top)
{
    if (b % 2 == 0) {
        some_green(c0, c1, b, q, 0, 1, bins, sum, top);
    } else {
        some_green(c0, c1, b, q, 0, 2, bins, sum, top);
        some_green(c0, c1, b, 1 - q, 1, 2, bins, sum, top);
    }
}

CAP_PIX_INLINE void across(const struct cap_pix *j, const struct columns c[2], int b, int32_t bins,
                           struct bins *out)
{
    /* colours of the 2x2 cell; at[0] != 1: the cell starts with the row's own colour, else with green */
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

/* Bins of row Y; the number of the first bin is even. */
static void pixel_put(const struct cap_pix *j, int32_t Y, const struct bins *v, int32_t bins,
                      float *out)
{
    const int b = j->binning;
    const float own = cap_pix_scale(j, 4 * b * b);
    struct cap_pix_bins p = {
        {v->sum[0], v->sum[1], v->sum[2]},
        {v->top[0], v->top[1], v->top[2]},
        {{own, own}, {0}, {own, own}},
    };
    for (int k = 0; k < 2;
         k++) { /* with odd b, a bin has one more green pixel if its first pixel is green */
        const bool green = ((Y + k) % 2 == 0) == (j->cell[0] == 1);
        p.scale[1][k] = cap_pix_scale(j, (b * b + (b % 2 != 0 && green)) / 2);
    }
    pix_finish(j, &p, bins, out);
}

/* One piece of a row of bins. */
static void pixel_bins_of(const struct cap_pix *j, int32_t Y, int32_t x, int32_t n,
                          const struct edges *e, float *out)
{
    struct columns c[2];
    struct bins v;
    const int b = j->binning;
    const int32_t bins = n / b;
    pixel_down(j, Y, x, n, e, c);
    if (b == 2)
        across(j, c, 2, bins, &v);
    else if (b == 3)
        across(j, c, 3, bins, &v);
    else if (b == 4)
        across(j, c, 4, bins, &v);
    else if (b == 5)
        across(j, c, 5, bins, &v);
    else
        across(j, c, b, bins, &v);
    pixel_put(j, Y, &v, bins, out);
}

static void pix_mosaic(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    struct cap_pix_line line[4];
    struct edges e = {&line[0], &line[1], &line[2], &line[3]};
    int32_t b = j->binning, w = j->img.width, bw = w / b;
    int32_t unit = b % 4 == 0 ? b : b % 2 == 0 ? 2 * b : 4 * b, piece = CAP_PIX_PIECE / unit * unit;
    for (int32_t x = 0; x < w && y0 < y1; x += piece) {
        int32_t n = w - x < piece ? w - x : piece;
        cap_pix_fetch(j, y0 * b, x, n, e.below);
        cap_pix_fetch(j, y0 * b - 1, x, n, e.last);
        for (int32_t Y = y0; Y < y1;
             Y++) { /* the two rows at the upper edge were fetched for the bins above */
            e = (struct edges){e.last, e.below, e.above, e.first};
            cap_pix_fetch(j, (Y + 1) * b, x, n, e.below);
            cap_pix_fetch(j, (Y + 1) * b - 1, x, n, e.last);
            pixel_bins_of(j, Y, x, n, &e,
                          out + ((size_t)Y * (size_t)bw + (size_t)(x / b)) * (j->nch == 3 ? 4 : 1));
        }
    }
}
#endif
