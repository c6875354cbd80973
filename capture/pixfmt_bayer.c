/* pixfmt_bayer.c - Bayer images at binning 1: bilinear interpolation, or each pixel as it is.
 *
 * A row's pixels alternate between the row's own colour (red or blue) and green.  At a pixel with
 *     h = left + right,  v = above + below,  x = the four diagonal ones
 * the missing colours are (h + v)/4 and x/4 at red and blue, h/2 and v/2 at green. */
#include "capture/pixfmt_priv.h"

enum { PIECE = 512 }; /* pixels at a time, and one more on each side */

/* A piece of a row: values to be added, and whether they are saturated. */
struct piece {
    uint32_t v[PIECE + 2], sat[PIECE + 2]; /* pixel x is at x - first + 1 */
};

static void values(const struct cap_pix *j, const uint16_t *s, int32_t n, struct piece *p)
{
    const uint32_t full = j->full;
    if (j->table != NULL)
        for (int32_t i = 0; i < n; i++)
            p->v[i + 1] = j->table[s[i] < full ? s[i] : full];
    else
        for (int32_t i = 0; i < n; i++)
            p->v[i + 1] = s[i];
    for (int32_t i = 0; i < n; i++)
        p->sat[i + 1] = s[i] >= full ? ~0u : 0;
}

static void one_value(const struct cap_pix *j, int32_t x, int32_t y, int32_t at, struct piece *p)
{
    unsigned v = cap_pix_sample(j, x, y, 0);
    p->sat[at] = v >= j->full ? ~0u : 0;
    p->v[at] = j->table == NULL ? v : j->table[v < j->full ? v : j->full];
}

/* Pixels x-1 .. x+n of row y, mirrored at the image's border. */
static void take(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, struct piece *p)
{
    uint16_t s[PIECE];
    int32_t w = j->img.width;
    cap_pix_row(j, y, x, n, s);
    values(j, s, n, p);
    one_value(j, x > 0 ? x - 1 : 1, y, 0, p);
    one_value(j, x + n < w ? x + n : w - 2, y, n + 1, p);
}

/* Planes of one row's missing colours: at each pixel the sums that it can give. */
struct planes {
    uint32_t h[PIECE], v[PIECE], hv[PIECE], x[PIECE];     /* sums */
    uint32_t mh[PIECE], mv[PIECE], mhv[PIECE], mx[PIECE]; /* saturated */
};

static void neighbours(const struct piece *restrict up, const struct piece *restrict mid,
                       const struct piece *restrict down, int32_t n, struct planes *restrict q)
{
    uint32_t v[PIECE + 2], m[PIECE + 2];
    for (int32_t i = 0; i < n + 2; i++) {
        v[i] = up->v[i] + down->v[i];
        m[i] = up->sat[i] | down->sat[i];
    }
    for (int32_t i = 0; i < n; i++) {
        q->h[i] = mid->v[i] + mid->v[i + 2];
        q->mh[i] = mid->sat[i] | mid->sat[i + 2];
        q->v[i] = v[i + 1];
        q->mv[i] = m[i + 1];
        q->hv[i] = q->h[i] + v[i + 1];
        q->mhv[i] = q->mh[i] | m[i + 1];
        q->x[i] = v[i] + v[i + 2];
        q->mx[i] = m[i] | m[i + 2];
    }
}

CAP_PIX_INLINE void put(float *out, int nch, const uint32_t s[3], const uint32_t m[3],
                        const float scale[3])
{
    if (nch == 3) {
        const cap_i4 bad = {(int32_t)m[0], (int32_t)m[1], (int32_t)m[2], 0};
        const cap_i4 sum = {(int32_t)s[0], (int32_t)s[1], (int32_t)s[2], 0};
        const cap_f4 one = {1, 1, 1, 1}, k = {scale[0], scale[1], scale[2], 0};
        cap_f4 v = __builtin_convertvector(sum, cap_f4) * k;
        *(cap_f4 *)out = (cap_f4)(((cap_i4)one & bad) | ((cap_i4)v & ~bad));
        return;
    }
    float rgb[3];
    bool saturated[3];
    for (int c = 0; c < 3; c++) {
        saturated[c] = m[c] != 0;
        rgb[c] = (float)(int32_t)s[c] * scale[c];
    }
    cap_pix_put(out, rgb, saturated, false, 1);
}

/* Row of colours `own` (0 red, 2 blue) and green; green_first: the even pixels are green. */
CAP_PIX_INLINE void mix(const struct cap_pix *j, const struct piece *mid, const struct planes *q,
                        int32_t n, int own, bool green_first, int nch, float *out)
{
    const float one = cap_pix_scale(j, 1), two = cap_pix_scale(j, 2), four = cap_pix_scale(j, 4);
    const int far = 2 - own;
    float at_green[3], at_own[3];
    at_green[own] = at_green[far] = two;
    at_green[1] = at_own[own] = one;
    at_own[1] = at_own[far] = four;
    for (int32_t i = 0; i < n; i++) {
        uint32_t s[3], m[3];
        if ((i % 2 == 0) == green_first) {
            s[own] = q->h[i];
            m[own] = q->mh[i];
            s[far] = q->v[i];
            m[far] = q->mv[i];
            s[1] = mid->v[i + 1];
            m[1] = mid->sat[i + 1];
            put(out + (size_t)i * (nch == 3 ? 4 : 1), nch, s, m, at_green);
        } else {
            s[own] = mid->v[i + 1];
            m[own] = mid->sat[i + 1];
            s[1] = q->hv[i];
            m[1] = q->mhv[i];
            s[far] = q->x[i];
            m[far] = q->mx[i];
            put(out + (size_t)i * (nch == 3 ? 4 : 1), nch, s, m, at_own);
        }
    }
}

static void mix_row(const struct cap_pix *j, const struct piece *mid, const struct planes *q,
                    int32_t n, int32_t y, float *out)
{
    const uint8_t *c = j->cell + (y & 1) * 2;
    if (j->nch == 1)
        mix(j, mid, q, n, c[0] == 1 ? c[1] : c[0], c[0] == 1, 1, out);
    else if (c[0] == 1)
        mix(j, mid, q, n, c[1], true, 3, out);
    else
        mix(j, mid, q, n, c[0], false, 3, out);
}

static void demosaic(const struct cap_pix *j, int32_t x, int32_t n, int32_t y0, int32_t y1,
                     float *out)
{
    struct piece row[3]; /* above, at and below, in turn */
    struct planes q;
    int32_t w = j->img.width, h = j->img.height;
    take(j, y0 > 0 ? y0 - 1 : 1, x, n, &row[(y0 + 2) % 3]);
    take(j, y0, x, n, &row[y0 % 3]);
    for (int32_t y = y0; y < y1; y++) {
        take(j, y + 1 < h ? y + 1 : h - 2, x, n, &row[(y + 1) % 3]);
        neighbours(&row[(y + 2) % 3], &row[y % 3], &row[(y + 1) % 3], n, &q);
        mix_row(j, &row[y % 3], &q, n, y,
                out + ((size_t)y * (size_t)w + (size_t)x) * (j->nch == 3 ? 4 : 1));
    }
}

/* Each pixel in the lane of its colour. */
static void rays(const struct cap_pix *j, int32_t x, int32_t n, int32_t y, float *out)
{
    uint16_t s[PIECE];
    const float scale = cap_pix_scale(j, 1);
    const unsigned full = j->full;
    const int first = j->cell[(y & 1) * 2], second = j->cell[(y & 1) * 2 + 1];
    const cap_f4 none = {NAN, NAN, NAN, 0};
    cap_pix_row(j, y, x, n, s);
    for (int32_t i = 0; i < n; i++) {
        uint32_t v = j->table == NULL ? s[i] : j->table[s[i] < full ? s[i] : full];
        *(cap_f4 *)(out + (size_t)i * 4) = none;
        out[(size_t)i * 4 + (size_t)(i % 2 == 0 ? first : second)] =
            s[i] >= full ? 1.0f : (float)(int32_t)v * scale;
    }
}

void cap_pix_bayer(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    int32_t w = j->img.width;
    if (!j->rays) {
        for (int32_t x = 0; x < w && y0 < y1; x += PIECE)
            demosaic(j, x, w - x < PIECE ? w - x : PIECE, y0, y1, out);
        return;
    }
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = 0; x < w; x += PIECE)
            rays(j, x, w - x < PIECE ? w - x : PIECE, y,
                 out + ((size_t)y * (size_t)w + (size_t)x) * 4);
}
