/* pixfmt_ref.c - the readable implementation of cap_convert: any format, any binning, sample by sample. */
#include <string.h>

#include "capture/pixel/pixfmt_priv.h"

static unsigned pixfmt_ref_word(const uint8_t *p)
{
    uint16_t v;
    memcpy(&v, p, sizeof v);
    return v;
}

/* `depth` bits from bit `at` on, least significant first. */
static unsigned pixfmt_ref_bits(const uint8_t *p, size_t at, int depth)
{
    unsigned v = 0;
    for (int i = 0; i < depth; i++, at++)
        v |= (p[at / 8] >> at % 8 & 1u) << i;
    return v;
}

static unsigned yuv(const struct cap_pix *j, const uint8_t *pair, int x, int s)
{
    bool uyvy = j->img.fmt == CAP_UYVY;
    cap_f4 chroma = cap_pix_chroma(&j->yuv, pair[1 - uyvy], pair[3 - uyvy]);
    return (unsigned)cap_pix_yuv(&j->yuv, pair[x * 2 + uyvy], chroma)[s];
}

unsigned cap_pix_sample(const struct cap_pix *j, int32_t x, int32_t y, int s)
{
    const uint8_t *row = (const uint8_t *)j->img.data + y * j->img.stride, *t;
    size_t u = (size_t)x, i = u * (size_t)j->samples + (size_t)(j->swapped ? 2 - s : s);
    int depth = cap_pixfmt_depth(j->img.fmt), odd = x & 1;
    switch (cap_pixfmt_layout(j->img.fmt)) {
    case CAP_LAYOUT_8: return row[i];
    case CAP_LAYOUT_16: return pixfmt_ref_word(row + i * 2);
    case CAP_LAYOUT_P: return pixfmt_ref_bits(row, i * (size_t)depth, depth);
    case CAP_LAYOUT_PACKED:
        t = row + u / 2 * 3; /* high bits in bytes 0 and 2, low ones in the halves of byte 1 */
        return (unsigned)(t[odd * 2] << (depth - 8) | (t[1] >> odd * 4 & ((1 << (depth - 8)) - 1)));
    case CAP_LAYOUT_CSI:
        if (depth == 10) { /* four high bytes, then 2 bits of each, the first in the lowest */
            t = row + u / 4 * 5;
            return (unsigned)(t[u % 4] << 2 | (t[4] >> u % 4 * 2 & 3));
        }
        t = row + u / 2 * 3;
        return (unsigned)(t[odd] << 4 | (t[2] >> odd * 4 & 15));
    case CAP_LAYOUT_YUV: return yuv(j, row + u / 2 * 4, odd, s);
    case CAP_LAYOUT_NONE:
    case CAP_LAYOUT_JPEG:
    case CAP_LAYOUT_F32: break;
    }
    return 0;
}

/* Sum of one channel of one bin so far. */
struct gather {
    double sum;
    int count;
    bool saturated;
};

static void add_weighted(struct gather *g, const struct cap_pix *j, int32_t x, int32_t y, int s,
                         int weight)
{
    if (j->maps != NULL && j->maps->mask != NULL && cap_pix_masked(j->maps, x, y))
        return;
    if (j->plane != NULL) {
        float p = j->plane[((size_t)y * (size_t)j->img.width + (size_t)x) * (size_t)j->samples +
                           (size_t)s];
        if (isfinite(p)) {
            g->sum += weight * (double)p;
            g->count += weight;
        }
        return;
    }
    unsigned v = cap_pix_sample(j, x, y, s);
    g->saturated |= v >= j->clip;
    g->sum += v >= j->clip ? 0 : weight * (double)(j->table != NULL ? j->table[v] : v);
    g->count += weight;
}

static void pixfmt_ref_add(struct gather *g, const struct cap_pix *j, int32_t x, int32_t y, int s)
{
    if (j->full > 0 || j->plane != NULL) {
        add_weighted(g, j, x, y, s, 1);
        return;
    }
    if (j->maps != NULL && j->maps->mask != NULL && cap_pix_masked(j->maps, x, y))
        return;
    float v;
    const char *row = (const char *)j->img.data + y * j->img.stride;
    memcpy(&v, row + ((size_t)x * (size_t)j->samples + (size_t)s) * sizeof v, sizeof v);
    if (isfinite(v)) {
        g->sum += v;
        g->count++;
    }
}

static float pixfmt_ref_mean_of(const struct gather *g, const struct cap_pix *j)
{
    if (g->saturated)
        return j->most;
    if (g->count == 0)
        return NAN;
    if (j->full > 0 && j->plane == NULL)
        return (float)g->sum * cap_pix_scale(j, g->count);
    return (float)(g->sum / g->count);
}

static int32_t mirrored(int32_t i, int32_t n)
{
    return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i;
}

/* Bilinear: a pixel's own colour is its sample, the others are the mean of that colour's samples
 * among the 8 neighbours (2 beside or above and below, or 4 around). */
static void around(const struct cap_pix *j, int32_t x, int32_t y, struct gather g[3])
{
    int own = j->cell[(y & 1) * 2 + (x & 1)];
    pixfmt_ref_add(&g[own], j, x, y, 0);
    for (int32_t dy = -1; dy <= 1 && !j->rays; dy++)
        for (int32_t dx = -1; dx <= 1; dx++) {
            int32_t u = mirrored(x + dx, j->img.width), v = mirrored(y + dy, j->img.height);
            int c = j->cell[(v & 1) * 2 + (u & 1)];
            if (c != own)
                pixfmt_ref_add(&g[c], j, u, v, 0);
        }
}

/* Along one axis, sample u stands for two pixels about it.  Their overlap with bin X, in half pixels. */
static int overlap(int32_t u, int32_t X, int b)
{
    int32_t lo = 2 * u - 2 > 2 * X * b - 1 ? 2 * u - 2 : 2 * X * b - 1;
    int32_t hi = 2 * u + 2 < 2 * (X + 1) * b - 1 ? 2 * u + 2 : 2 * (X + 1) * b - 1;
    return hi > lo ? hi - lo : 0;
}

/* Bayer, binning >= 2: the bin's own samples of green; each sample of red and blue as far as the four pixels that
 * it stands for lie in the bin. */
static void mosaic_bin(const struct cap_pix *j, int32_t X, int32_t Y, struct gather g[3])
{
    int b = j->binning;
    for (int32_t y = Y * b - 1; y <= (Y + 1) * b; y++)
        for (int32_t x = X * b - 1; x <= (X + 1) * b; x++) {
            int32_t u = mirrored(x, j->img.width), v = mirrored(y, j->img.height);
            int c = j->cell[(y & 1) * 2 + (x & 1)];
            bool inside = x / b == X && y / b == Y && x >= 0 && y >= 0;
            int weight = c == 1 ? inside : overlap(x, X, b) * overlap(y, Y, b);
            if (weight > 0)
                add_weighted(&g[c], j, u, v, 0, weight);
        }
}

/* (1) of maps.h for the bin at out, channel by channel. */
static void map_bin(const struct cap_pix *j, size_t bin, const bool saturated[3], float *out)
{
    const struct cap_maps *m = j->maps;
    const bool one = j->cell != NULL && j->rays && j->binning == 1;
    bool full = false;
    for (size_t c = 0; c < (size_t)j->nch; c++) {
        bool top = saturated[j->grey ? 0 : c] || (j->nch == 1 && (saturated[1] || saturated[2]));
        float v = j->full > 0 ? out[c] : out[c] * m->unit;
        v = cap_pix_map(v, m->word[(one ? 0 : c) * m->plane + bin]);
        out[c] = top && j->full > 0 ? m->saturated : v;
        full |= top && j->full > 0;
    }
    if (!m->has_matrix)
        return;
    const float *a = m->matrix, r = out[0], g = out[1], b = out[2];
    for (int c = 0; c < 3; c++)
        out[c] = full ? m->saturated : a[3 * c] * r + a[3 * c + 1] * g + a[3 * c + 2] * b;
}

void cap_pix_ref_bin(const struct cap_pix *j, int32_t X, int32_t Y, float *out)
{
    int b = j->binning;
    size_t bin = (size_t)Y * (size_t)(j->img.width / b) + (size_t)X;
    struct gather g[3] = {{0}};
    if (j->cell != NULL && b == 1)
        around(j, X, Y, g);
    else if (j->cell != NULL)
        mosaic_bin(j, X, Y, g);
    else
        for (int32_t y = Y * b; y < (Y + 1) * b; y++)
            for (int32_t x = X * b; x < (X + 1) * b; x++)
                for (int s = 0; s < j->samples; s++)
                    pixfmt_ref_add(&g[s], j, x, y, s);
    float rgb[3], *o = out + bin * (j->nch == 3 ? 4 : 1);
    bool saturated[3] = {false}, lacking = false;
    for (int c = 0; c < 3; c++) {
        rgb[c] = pixfmt_ref_mean_of(&g[c], j);
        saturated[c] = g[c].saturated;
        lacking |= g[c].count == 0 && !(j->grey && c > 0);
    }
    cap_pix_put(o, rgb, saturated, j->most, j->grey, j->nch);
    if (lacking && j->full > 0 && j->nch == 1 && j->maps != NULL && j->maps->mask != NULL)
        o[0] = NAN; /* the mean of fewer channels is a different quantity */
    if (j->maps != NULL && j->plane == NULL)
        map_bin(j, bin, saturated, o);
}

void cap_pix_ref(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    for (int32_t Y = y0; Y < y1; Y++)
        for (int32_t X = 0; X < j->img.width / j->binning; X++)
            cap_pix_ref_bin(j, X, Y, out);
}
