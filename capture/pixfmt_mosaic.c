/* pixfmt_mosaic.c - Bayer images at even binning b.
 *
 * Green: the bin's own samples, whose centre of gravity is the bin's.  Red's and blue's would be half a
 * pixel off, so each of their samples counts as far as the 2x2 pixels that it stands for lie in the bin:
 * along each axis, in half pixels, 4 inside, 3 for the sample at the bin's edge and 1 for the next one
 * beyond the other edge,
 *     weighted sum = 4 (sum of the bin's own) - the one at the edge + the one beyond                (1)
 * with weights (2b)^2 in all.  Down the rows first, for all columns, then across. */
#include "capture/pixfmt_priv.h"

enum { PIECE = 512 }; /* pixels at a time, and one more on each side */

/* Pixels x-1 .. x+n of one row; a saturated one is marked and adds nothing. */
struct line {
    uint32_t v[PIECE + 2], sat[PIECE + 2];
};
/* Sums down the rows of one parity: own rows of the bin, and (1). */
struct columns {
    uint32_t sum[PIECE + 2], sat[PIECE + 2], sum1[PIECE + 2], sat1[PIECE + 2];
};
/* Bins: sums and marks per channel. */
struct bins {
    uint32_t sum[3][PIECE], sat[3][PIECE];
};

static void one_value(const struct cap_pix *j, int32_t x, int32_t y, int32_t at, struct line *l)
{
    unsigned v = cap_pix_sample(j, x, y, 0);
    l->sat[at] = v >= j->full;
    l->v[at] = v >= j->full ? 0 : j->table == NULL ? v : j->table[v];
}

static void take(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, struct line *restrict l)
{
    uint16_t s[PIECE];
    const uint32_t full = j->full;
    const uint32_t *table = j->table;
    int32_t w = j->img.width, h = j->img.height;
    y = y < 0 ? -y : y >= h ? 2 * h - 2 - y : y;
    cap_pix_row(j, y, x, n, s);
    if (table == NULL)
        for (int32_t i = 0; i < n; i++) {
            l->v[i + 1] = s[i] >= full ? 0 : s[i];
            l->sat[i + 1] = s[i] >= full;
        }
    else
        for (int32_t i = 0; i < n; i++) {
            l->v[i + 1] = s[i] >= full ? 0 : table[s[i]];
            l->sat[i + 1] = s[i] >= full;
        }
    one_value(j, x > 0 ? x - 1 : 1, y, 0, l);
    one_value(j, x + n < w ? x + n : w - 2, y, n + 1, l);
}

/* Sums down the rows of one parity of a bin: at its edge, `beyond` the other one, and from row y on those
 * between. */
static void down(const struct cap_pix *j, const struct line *restrict edge,
                 const struct line *restrict beyond, int32_t y, int32_t x, int32_t n,
                 struct columns *restrict c)
{
    struct line l;
    if (j->binning == 2) {
        for (int32_t i = 0; i < n + 2; i++) {
            c->sum[i] = edge->v[i];
            c->sat[i] = edge->sat[i];
            c->sum1[i] = 3 * edge->v[i] + beyond->v[i];
            c->sat1[i] = edge->sat[i] | beyond->sat[i];
        }
        return;
    }
    for (int32_t i = 0; i < n + 2; i++) {
        c->sum[i] = edge->v[i];
        c->sat[i] = edge->sat[i];
    }
    for (int r = 1; r < j->binning / 2; r++) {
        take(j, y + 2 * (r - 1), x, n, &l);
        for (int32_t i = 0; i < n + 2; i++) {
            c->sum[i] += l.v[i];
            c->sat[i] |= l.sat[i];
        }
    }
    for (int32_t i = 0; i < n + 2; i++) {
        c->sum1[i] = 4 * c->sum[i] - edge->v[i] + beyond->v[i];
        c->sat1[i] = c->sat[i] | beyond->sat[i];
    }
}

/* (1) along the row for red or blue at the columns of parity q. */
CAP_PIX_INLINE void across_one(const uint32_t *restrict v, const uint32_t *restrict m, int b, int q,
                               int32_t bins, uint32_t *restrict sum, uint32_t *restrict sat)
{
    const int32_t edge = q == 0 ? 0 : b - 1, beyond = q == 0 ? b : -1;
    v++;
    m++;
    for (int32_t X = 0; X < bins; X++) {
        uint32_t s = 0, f = m[X * b + beyond];
        for (int i = q; i < b; i += 2) {
            s += v[X * b + i];
            f |= m[X * b + i];
        }
        sum[X] = 4 * s - v[X * b + edge] + v[X * b + beyond];
        sat[X] = f;
    }
}

/* Green, at the columns of parity q of this row's and 1-q of the other's. */
CAP_PIX_INLINE void across_green(const struct columns *restrict c0,
                                 const struct columns *restrict c1, int b, int q, int32_t bins,
                                 uint32_t *restrict sum, uint32_t *restrict sat)
{
    for (int32_t X = 0; X < bins; X++) {
        uint32_t s = 0, f = 0;
        for (int i = 0; i < b; i += 2) {
            s += c0->sum[1 + X * b + i + q] + c1->sum[1 + X * b + i + 1 - q];
            f |= c0->sat[1 + X * b + i + q] | c1->sat[1 + X * b + i + 1 - q];
        }
        sum[X] = s;
        sat[X] = f;
    }
}

CAP_PIX_INLINE void across(const struct cap_pix *j, const struct columns c[2], int b, int32_t bins,
                           struct bins *out)
{
    /* where the rows' own colours are; a green pixel comes first in the other case */
    if (j->cell[0] != 1) {
        across_one(c[0].sum1, c[0].sat1, b, 0, bins, out->sum[j->cell[0]], out->sat[j->cell[0]]);
        across_one(c[1].sum1, c[1].sat1, b, 1, bins, out->sum[j->cell[3]], out->sat[j->cell[3]]);
        across_green(&c[0], &c[1], b, 1, bins, out->sum[1], out->sat[1]);
    } else {
        across_one(c[0].sum1, c[0].sat1, b, 1, bins, out->sum[j->cell[1]], out->sat[j->cell[1]]);
        across_one(c[1].sum1, c[1].sat1, b, 0, bins, out->sum[j->cell[2]], out->sat[j->cell[2]]);
        across_green(&c[0], &c[1], b, 0, bins, out->sum[1], out->sat[1]);
    }
}

static void put(const struct cap_pix *j, const struct bins *v, int32_t bins, float *out)
{
    int b = j->binning;
    const float own = cap_pix_scale(j, 4 * b * b), green = cap_pix_scale(j, b * b / 2);
    const cap_f4 one = {1, 1, 1, 1}, scale = {own, green, own, 0};
    for (int32_t X = 0; X < bins; X++) {
        const cap_i4 s = {(int32_t)v->sum[0][X], (int32_t)v->sum[1][X], (int32_t)v->sum[2][X], 0};
        const cap_i4 m = {(int32_t)v->sat[0][X], (int32_t)v->sat[1][X], (int32_t)v->sat[2][X], 0};
        const cap_i4 bad = m != 0;
        cap_f4 rgb = __builtin_convertvector(s, cap_f4) * scale;
        rgb = (cap_f4)(((cap_i4)one & bad) | ((cap_i4)rgb & ~bad));
        if (j->nch == 3) {
            *(cap_f4 *)(out + (size_t)X * 4) = rgb;
        } else {
            const float p[3] = {rgb[0], rgb[1], rgb[2]};
            const bool saturated[3] = {bad[0] != 0, bad[1] != 0, bad[2] != 0};
            cap_pix_put(out + X, p, saturated, false, 1);
        }
    }
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

void cap_pix_mosaic(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
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
