#include "recon/photo.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

const struct rec_photo_params rec_photo_defaults = REC_PHOTO_DEFAULTS;

#define BLOCK 8
#define LIMIT 1e9f /* full scales; more is no measurement, and squares stay finite in float */
enum { UNLIT = 0, LIT = 1, FORCED = 2 };

/* k-th smallest of v [n], v is reordered (Hoare's selection, middle pivot). */
static float select_kth(float *v, int32_t n, int32_t k)
{
    int32_t lo = 0, hi = n - 1;
    while (lo < hi) {
        float pivot = v[lo + (hi - lo) / 2];
        int32_t i = lo, j = hi;
        while (i <= j) {
            while (v[i] < pivot)
                i++;
            while (v[j] > pivot)
                j--;
            if (i <= j) {
                float t = v[i];
                v[i++] = v[j];
                v[j--] = t;
            }
        }
        if (k <= j)
            hi = j;
        else if (k >= i)
            lo = i;
        else
            break;
    }
    return v[k];
}

struct block { float mean, noise2, zeros; };

/* Mean, noise variance and share of the most common low value 0 in one block of a channel.  The
 * mixed second difference a-b-c+d of 2x2 bins is blind to any linear slope, and its variance is 4
 * sigma^2 for independent noise.  false: too few measured bins. */
static bool measure_block(const float *img, int32_t bw, int32_t bh, int cs, const float *weight,
                          int32_t x0, int32_t y0, float low, struct block *out)
{
    int32_t x1 = x0 + BLOCK < bw ? x0 + BLOCK : bw, y1 = y0 + BLOCK < bh ? y0 + BLOCK : bh;
    double mean = 0, d2 = 0;
    int32_t cells = 0, bins = 0, at_low = 0;
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = x0; x < x1; x++) {
            size_t i = (size_t)y * (size_t)bw + (size_t)x, j = i + (size_t)bw;
            if (weight[i] == 0)
                continue;
            float a = img[i * (size_t)cs];
            mean += a;
            bins++;
            at_low += a <= low;
            if (x + 1 == x1 || y + 1 == y1 || weight[i + 1] == 0 || weight[j] == 0 ||
                weight[j + 1] == 0)
                continue;
            double d = (double)a - img[(i + 1) * (size_t)cs] - img[j * (size_t)cs] +
                       img[(j + 1) * (size_t)cs];
            d2 += d * d;
            cells++;
        }
    if (cells < 4)
        return false;
    out->mean = (float)(mean / bins);
    out->noise2 = (float)(d2 / (4.0 * cells));
    out->zeros = (float)at_low / (float)bins;
    return true;
}

/* Noise of one channel: median over the darker half of the blocks.  A camera that clips at black
 * keeps only the upper half of the background's noise; its blocks are then about half filled with
 * the lowest value, and max(0, N(0,s)) has the standard deviation 0.5838 s. */
static float noise(const float *img, int32_t bw, int32_t bh, int cs, const float *weight,
                   float *scratch)
{
    int32_t n = 0, max = bw * bh / 3;
    float low = INFINITY;
    for (int32_t i = 0; i < bw * bh; i++)
        if (weight[i] != 0 && img[(size_t)i * (size_t)cs] < low)
            low = img[(size_t)i * (size_t)cs];
    float *mean = scratch, *noise2 = scratch + max, *zeros = scratch + 2 * max;
    for (int32_t y = 0; y < bh; y += BLOCK)
        for (int32_t x = 0; x < bw; x += BLOCK) {
            struct block b;
            if (n < max && measure_block(img, bw, bh, cs, weight, x, y, low, &b)) {
                noise2[n] = b.noise2;
                zeros[n] = b.zeros;
                mean[n++] = b.mean;
            }
        }
    if (n == 0)
        return 0;
    /* Keep the darker half, in place; the selection works on a copy in the unused end of `mean`'s
     * third, which has room for it: a block is at least 9 bins, three values each. */
    int32_t half = 0;
    float *sorted = mean + n;
    memcpy(sorted, mean, (size_t)n * sizeof *sorted);
    float limit = select_kth(sorted, n, n / 2);
    for (int32_t i = 0; i < n; i++)
        if (mean[i] <= limit) {
            noise2[half] = noise2[i];
            zeros[half++] = zeros[i];
        }
    float v = select_kth(noise2, half, half / 2), z = select_kth(zeros, half, half / 2);
    float s = sqrtf(v);
    return z > 0.25f && z < 0.75f ? s / 0.5838f : s;
}

/* Faint edges: the mean of 3x3 bins has a third of the noise, so it may be judged three times as
 * sharply.  Bins on the image's border have no such mean.  `sums`: a row of sums over three rows. */
static void light_means(const float *img, int32_t bw, int32_t bh, int nch,
                        const struct rec_photo_params *p, const float sigma[3], uint8_t *lit,
                        float *sums)
{
    size_t cs = nch == 3 ? 4 : 1, row = (size_t)bw * cs;
    float limit[3];
    if (bw < 3 || bh < 4) /* the work area holds bw*bh floats */
        return;
    for (int c = 0; c < nch; c++)
        limit[c] = 9 * fmaxf(p->floor, p->auto_k * sigma[c] / 3);
    for (int32_t y = 1; y + 1 < bh; y++) {
        const float *at = img + (size_t)y * row;
        uint8_t *out = lit + (size_t)y * (size_t)bw;
        for (size_t i = 0; i < row; i++)
            sums[i] = at[i] + (at - row)[i] + at[i + row];
        for (size_t x = 1; x + 1 < (size_t)bw; x++) {
            const float *s = sums + x * cs;
            bool is = false;
            for (int c = 0; c < nch; c++)
                is = is || s[c] + (s - cs)[c] + s[(size_t)c + cs] >= limit[c];
            if (is && out[x] == UNLIT)
                out[x] = LIT;
        }
    }
}

/* Bins with fewer than two lit neighbours go out; out of the image counts as unlit. */
static void despeckle(uint8_t *lit, int32_t bw, int32_t bh, uint8_t *copy)
{
    memcpy(copy, lit, (size_t)bw * (size_t)bh);
    for (int32_t y = 0; y < bh; y++)
        for (int32_t x = 0; x < bw; x++) {
            uint8_t *p = &lit[(size_t)y * (size_t)bw + (size_t)x];
            if (*p != LIT)
                continue;
            int count = -1;
            for (int32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < bh; v++)
                for (int32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < bw; u++)
                    count += copy[(size_t)v * (size_t)bw + (size_t)u] != UNLIT;
            if (count < 2)
                *p = UNLIT;
        }
}

/* Square dilation by `r`, rows then columns, each by a running count. */
static void grow(uint8_t *lit, int32_t bw, int32_t bh, int32_t r, uint8_t *copy)
{
    if (r <= 0)
        return;
    for (int pass = 0; pass < 2; pass++) {
        int32_t len = pass == 0 ? bw : bh, lines = pass == 0 ? bh : bw;
        size_t step = pass == 0 ? 1 : (size_t)bw, next = pass == 0 ? (size_t)bw : 1;
        memcpy(copy, lit, (size_t)bw * (size_t)bh);
        for (int32_t l = 0; l < lines; l++) {
            const uint8_t *in = copy + (size_t)l * next;
            uint8_t *out = lit + (size_t)l * next;
            int32_t inside = 0;
            for (int32_t i = 0; i < r && i < len; i++)
                inside += in[(size_t)i * step] != UNLIT;
            for (int32_t i = 0; i < len; i++) {
                if (r < len - i)
                    inside += in[(size_t)(i + r) * step] != UNLIT;
                if (i > r)
                    inside -= in[(size_t)(i - r - 1) * step] != UNLIT;
                out[(size_t)i * step] = inside > 0;
            }
        }
    }
}

void rec_photo_apply(float *img, int32_t bw, int32_t bh, int nch, const float *background,
                     const float gain[3], const struct rec_photo_params *p, float *weight,
                     uint8_t *lit, float *scratch, struct rec_photo_stats *out)
{
    size_t n = (size_t)bw * (size_t)bh, cs = nch == 3 ? 4 : 1;
    *out = (struct rec_photo_stats){0};
    for (size_t i = 0; i < n; i++) {
        float *v = img + i * cs;
        bool finite = true, saturated = false;
        for (int c = 0; c < nch; c++) {
            saturated = saturated || v[c] >= p->saturation;
            v[c] = gain[c] * (v[c] - p->black - (background != NULL ? background[i * cs + c] : 0));
            finite = finite && fabsf(v[c]) <= LIMIT; /* false for NaN */
        }
        if (!finite)
            memset(v, 0, cs * sizeof *v);
        else if (cs == 4)
            v[3] = 0;
        out->not_finite += !finite;
        out->saturated += finite && saturated;
        weight[i] = finite && !saturated;
        lit[i] = finite && !saturated ? UNLIT : FORCED;
    }

    float limit[3] = {p->threshold, p->threshold, p->threshold};
    for (int c = 0; c < nch; c++) {
        out->sigma[c] = noise(img + c, bw, bh, (int)cs, weight, scratch);
        if (p->threshold < 0)
            limit[c] = fmaxf(p->floor, p->auto_k * out->sigma[c]);
        out->threshold = fmaxf(out->threshold, limit[c]);
    }
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < nch; c++)
            if (lit[i] == UNLIT && img[i * cs + c] >= limit[c])
                lit[i] = LIT;
    if (p->threshold < 0)
        light_means(img, bw, bh, nch, p, out->sigma, lit, scratch);
    if (p->threshold < 0 && p->despeckle)
        despeckle(lit, bw, bh, (uint8_t *)scratch);
    grow(lit, bw, bh, p->margin, (uint8_t *)scratch);
    for (size_t i = 0; i < n; i++) {
        lit[i] = lit[i] != UNLIT;
        out->lit += lit[i];
    }
}
