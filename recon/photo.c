#include "recon/carve/photo.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "recon/simd/lanes.h"
#include "recon/carve/photo_mosaic.h"

const struct rec_photo_params rec_photo_defaults = REC_PHOTO_DEFAULTS;

#define BLOCK       REC_PHOTO_BLOCK
#define MAX_BLOCKS  REC_PHOTO_BLOCKS
#define LIMIT       1e9f /* full scales; more is no measurement, and squares stay finite in float */
#define NEAR        3    /* sides of the squares whose means are judged */
#define WIDE        7    /* where the flame is faint against the noise: */
#define NOISY       7.5f /* its lit bins' mean over the noise */
#define WIDE_MARGIN 1.25f /* false alarms of overlapping squares are not lone speckles */
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

/* Noise of up to three channels in one block, and the share of bins at the lowest value.  The mixed
 * second difference a-b-c+d of 2x2 bins is blind to any linear slope, and its variance is 4 sigma^2
 * for independent noise; `step` bins lie between them.  Sums of at most 64 terms, so float will do.  false: too few bins. */
struct block {
    rec_f4 mean, noise2, at_low;
};

REC_INLINE bool measure_block(const float *img, int32_t bw, int32_t bh, size_t cs,
                              const float *weight, int32_t x0, int32_t y0, int32_t step, rec_f4 low,
                              struct block *out)
{
    int32_t x1 = x0 + BLOCK < bw ? x0 + BLOCK : bw, y1 = y0 + BLOCK < bh ? y0 + BLOCK : bh;
    rec_f4 mean = {0}, d2 = {0};
    rec_i4 at_low = {0};
    int32_t cells = 0, bins = 0;
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = x0; x < x1; x++) {
            size_t i = (size_t)y * (size_t)bw + (size_t)x, j = i + (size_t)(step * bw);
            size_t k = (size_t)step;
            if (weight[i] == 0)
                continue;
            rec_f4 a = rec_ld(img, i, cs);
            mean += a;
            at_low -= a <= low;
            bins++;
            if (x + step >= x1 || y + step >= y1 || weight[i + k] == 0 || weight[j] == 0 ||
                weight[j + k] == 0)
                continue;
            rec_f4 d = (a - rec_ld(img, i + k, cs)) - (rec_ld(img, j, cs) - rec_ld(img, j + k, cs));
            d2 += d * d;
            cells++;
        }
    if (cells < 4)
        return false;
    out->mean = mean / rec_splat((float)bins);
    out->noise2 = d2 / rec_splat(4 * (float)cells);
    out->at_low = __builtin_convertvector(at_low, rec_f4) / rec_splat((float)bins);
    return true;
}

/* Median over the darker half of n blocks.  A camera that clips at black keeps only the upper half
 * of the background's noise; its blocks are then about half filled with the lowest value, and
 * max(0, N(0,s)) has the standard deviation 0.5838 s.
 * *dark: the lower quartile of the blocks' means, the level that a background clipped at 0 keeps. */
float rec_photo_dark_noise(const float *mean, float *noise2, float *at_low, int32_t n,
                           float *sorted, float *dark)
{
    int32_t half = 0;
    memcpy(sorted, mean, (size_t)n * sizeof *sorted);
    float limit = select_kth(sorted, n, n / 2);
    *dark = fmaxf(0, select_kth(sorted, n, n / 4));
    for (int32_t i = 0; i < n; i++)
        if (mean[i] <= limit) {
            noise2[half] = noise2[i];
            at_low[half++] = at_low[i];
        }
    float s = sqrtf(select_kth(noise2, half, half / 2)), z = select_kth(at_low, half, half / 2);
    return z > 0.25f && z < 0.75f ? s / 0.5838f : s;
}

/* Noise of each channel from at most about MAX_BLOCKS blocks spread over the image; `low`: the lowest
 * value of the bins with weight. */
REC_INLINE void noise(const float *img, int32_t bw, int32_t bh, int nch, size_t cs,
                      const float *weight, int32_t step, rec_f4 low, float sigma[3], float dark[3])
{
    float mean[3][MAX_BLOCKS], noise2[3][MAX_BLOCKS], at_low[3][MAX_BLOCKS], sorted[MAX_BLOCKS];
    int32_t across = (bw + BLOCK - 1) / BLOCK, down = (bh + BLOCK - 1) / BLOCK, n = 0;
    int32_t every = (int32_t)(((int64_t)across * down + MAX_BLOCKS - 1) / MAX_BLOCKS);
    for (int32_t k = 0, skip = 0; k < across * down; k++, skip = skip + 1 < every ? skip + 1 : 0) {
        struct block b;
        if (skip != 0 || !measure_block(img, bw, bh, cs, weight, k % across * BLOCK,
                                        k / across * BLOCK, step, low, &b))
            continue;
        for (int c = 0; c < nch; c++) {
            mean[c][n] = b.mean[c];
            noise2[c][n] = b.noise2[c];
            at_low[c][n] = b.at_low[c];
        }
        n++;
    }
    for (int c = 0; c < nch; c++)
        sigma[c] =
            n == 0 ? 0 : rec_photo_dark_noise(mean[c], noise2[c], at_low[c], n, sorted, &dark[c]);
}

REC_INLINE rec_f4 at_most(rec_f4 v, rec_f4 cap)
{
    return rec_select(v < cap, v, cap);
}

/* Means over squares of `side` bins, odd, that reach `limit`: faint edges.  A mean has 1/side of the
 * noise and may be judged as much more sharply, above the level that the dark blocks have (noise
 * clipped at 0 has a positive mean).  A bin counts at most `cap`, so that a hot pixel does not light
 * its neighbours.  Bins nearer to the image's border than side/2 have no such mean.  `sums`: a row of
 * sums over `side` rows, aligned. */
REC_INLINE void light_means(const float *img, int32_t bw, int32_t bh, size_t cs, int32_t side,
                            rec_f4 limit, rec_f4 cap, uint8_t *lit, float *sums)
{
    int32_t r = side / 2;
    size_t w = (size_t)bw;
    limit *= rec_splat((float)(side * side));
    for (int32_t y = r; y + r < bh; y++) {
        uint8_t *out = lit + (size_t)y * w;
        const float *top = img + (size_t)(y - r) * w * cs;
        for (size_t x = 0; x < w; x++) {
            rec_f4 s = {0};
            for (int32_t v = 0; v < side; v++)
                s += at_most(rec_ld(top, (size_t)v * w + x, cs), cap);
            rec_st(sums, x, cs, s);
        }
        for (int32_t x = r; x + r < bw; x++) {
            rec_f4 s = {0};
            for (int32_t u = x - r; u <= x + r; u++)
                s += rec_ld(sums, (size_t)u, cs);
            out[x] |= rec_any(s >= limit);
        }
    }
}

/* Mean of the lit bins over the noise, in the channel where that is most; 0: nothing is lit. */
REC_INLINE float signal_to_noise(const float *img, size_t n, int nch, size_t cs, const uint8_t *lit,
                                 const float sigma[3])
{
    rec_d4 sum = {0};
    double total[4], best = 0;
    uint32_t count = 0;
    for (size_t i = 0; i < n; i++)
        if (lit[i] & LIT) {
            rec_add_product(&sum, rec_ld(img, i, cs), rec_splat(1));
            count++;
        }
    rec_put(total, &sum);
    for (int c = 0; c < nch && count > 0; c++)
        best = fmax(best, total[c] / count / fmax((double)sigma[c], 1e-9));
    return (float)best;
}

/* Bins with fewer than two lit neighbours go out; out of the image counts as unlit.  Rows are summed
 * over three in bytes, which compilers turn into vectors.  copy: 3 bw*bh bytes. */
static void despeckle(uint8_t *lit, int32_t bw, int32_t bh, uint8_t *copy)
{
    size_t n = (size_t)bw * (size_t)bh, w = (size_t)bw;
    uint8_t *sum = copy + n;
    for (size_t i = 0; i < n; i++)
        copy[i] = lit[i] != UNLIT;
    for (size_t y = 0; y < (size_t)bh; y++) {
        const uint8_t *at = copy + y * w;
        uint8_t *row = sum + 1, *p = lit + y * w;
        memcpy(row, at, w);
        for (size_t x = 0; y > 0 && x < w; x++)
            row[x] = (uint8_t)(row[x] + at[x - w]);
        for (size_t x = 0; y + 1 < (size_t)bh && x < w; x++)
            row[x] = (uint8_t)(row[x] + at[x + w]);
        sum[0] = row[w] = 0;
        for (size_t x = 0; x < w; x++) {
            uint8_t near = (uint8_t)(sum[x] + sum[x + 1] + sum[x + 2]);
            p[x] = p[x] == LIT && near < 3 ? UNLIT : p[x]; /* FORCED stays */
        }
    }
}

/* Square dilation by `r`: rows by a running count, then columns as the union of 2r+1 rows. */
static void grow(uint8_t *lit, int32_t bw, int32_t bh, int32_t r, uint8_t *copy)
{
    if (r <= 0)
        return;
    for (int32_t y = 0; y < bh; y++) {
        const uint8_t *in = lit + (size_t)y * (size_t)bw;
        uint8_t *out = copy + (size_t)y * (size_t)bw;
        int32_t inside = 0;
        for (int32_t x = 0; x < r && x < bw; x++)
            inside += in[x];
        for (int32_t x = 0; x < bw; x++) {
            if (r < bw - x)
                inside += in[x + r];
            if (x > r)
                inside -= in[x - r - 1];
            out[x] = inside > 0;
        }
    }
    for (int32_t y = 0; y < bh; y++) {
        uint8_t *out = lit + (size_t)y * (size_t)bw;
        int32_t y0 = y > r ? y - r : 0, y1 = r < bh - 1 - y ? y + r : bh - 1;
        memcpy(out, copy + (size_t)y0 * (size_t)bw, (size_t)bw);
        for (int32_t v = y0 + 1; v <= y1; v++)
            for (int32_t x = 0; x < bw; x++)
                out[x] |= copy[(size_t)v * (size_t)bw + (size_t)x];
    }
}

/* Everything of (1) but the growing; returns through `out` what it measured. */
REC_INLINE void apply(float *img, int32_t bw, int32_t bh, size_t cs, const uint8_t *cell,
                      const struct rec_grain *grain, const float *background, const float gain[3],
                      const struct rec_photo_params *p, float *weight, uint8_t *lit, float *scratch,
                      float *plane, struct rec_photo_stats *out)
{
    size_t n = (size_t)bw * (size_t)bh;
    int nch = cs == 4 ? 3 : 1;
    const rec_i4 all = {-1, cs == 4 ? -1 : 0, cs == 4 ? -1 : 0, 0}, none = {0};
    rec_f4 low = rec_splat(INFINITY);
    rec_f4 black = rec_splat(p->black), limit1 = rec_splat(LIMIT), zero = {0};
    rec_f4 scale = cs == 4 ? (rec_f4){gain[0], gain[1], gain[2], 0} : rec_splat(gain[0]);
    int32_t x = 0, y = 0;
    for (size_t i = 0; i < n; i++) {
        rec_i4 lanes = all;
        if (cell != NULL) {
            lanes = rec_mosaic_lane(cell, x, y);
            y += x + 1 == bw;
            x = x + 1 == bw ? 0 : x + 1;
        }
        rec_f4 v = rec_ld(img, i, cs);
        if (cs == 4) /* whatever is in the 4th lane */
            v = rec_select(lanes, v, zero);
        bool saturated = rec_any(v >= rec_splat(p->saturation));
        v -= black;
        if (background != NULL)
            v -= rec_ld(background, i, cs);
        v = scale * v;
        if (cell != NULL) /* a background's other channels */
            v = rec_select(lanes, v, zero);
        bool bad = !rec_all((v <= limit1) & (v >= -limit1)); /* NaN too */
        v = rec_select(bad ? none : lanes, v, zero);
        rec_st(img, i, cs, v);
        out->not_finite += bad;
        out->saturated += !bad && saturated;
        weight[i] = !bad && !saturated;
        rec_i4 lower = (v < low) & (rec_splat(weight[i]) != 0);
        low = rec_select(lower & lanes, v, low);
        lit[i] = bad || saturated ? FORCED : UNLIT;
    }

    const float *judged = img;
    float dark[3] = {0};
    rec_f4 near = rec_splat(NEAR), wide = rec_splat(WIDE); /* sigma over that of the means */
    if (grain != NULL) {
        near = grain->near;
        wide = grain->wide;
    }
    if (cell == NULL) {
        noise(img, bw, bh, nch, cs, weight, grain != NULL ? grain->step : 1, low, out->sigma, dark);
    } else {
        rec_mosaic_noise(img, bw, bh, cell, weight, low, out->sigma, dark);
        rec_mosaic_plane(img, bw, bh, plane);
        judged = plane;
    }
    rec_f4 limit = rec_splat(p->threshold), faint = limit, fainter = limit;
    bool automatic = p->threshold < 0;
    for (int c = 0; c < nch && automatic; c++) {
        limit[c] = fmaxf(p->floor, p->auto_k * out->sigma[c]);
        faint[c] = dark[c] + fmaxf(p->floor, p->auto_k * out->sigma[c] / near[c]);
        fainter[c] = dark[c] + fmaxf(p->floor, WIDE_MARGIN * p->auto_k * out->sigma[c] / wide[c]);
    }
    for (int c = 0; c < nch; c++)
        out->threshold = fmaxf(out->threshold, limit[c]);
    for (int c = nch; c < 4; c++) /* lanes that are not there are never lit */
        limit[c] = faint[c] = fainter[c] = INFINITY;
    for (size_t i = 0; i < n; i++)
        lit[i] |= rec_any(rec_ld(img, i, cs) >= limit) ||
                  (cell != NULL && rec_any(rec_ld(plane, i, cs) >= limit));
    if (!automatic ||
        bh < 5) /* the work area holds bw*bh floats; a row of sums needs up to 4 bw + 3 */
        return;
    float *sums = (float *)(((uintptr_t)scratch + 15) & ~(uintptr_t)15);
    light_means(judged, bw, bh, cs, NEAR, faint, limit + limit, lit, sums);
    float snr = signal_to_noise(judged, n, nch, cs, lit, out->sigma);
    if (snr > 0 && snr < NOISY)
        light_means(judged, bw, bh, cs, WIDE, fainter, rec_splat(4) * fainter, lit, sums);
}

static void finish(int32_t bw, int32_t bh, const struct rec_photo_params *p, uint8_t *lit,
                   float *scratch, struct rec_photo_stats *out)
{
    size_t n = (size_t)bw * (size_t)bh;
    if (p->threshold < 0 && p->despeckle)
        despeckle(lit, bw, bh, (uint8_t *)scratch);
    for (size_t i = 0; i < n; i++)
        lit[i] = lit[i] != UNLIT;
    grow(lit, bw, bh, p->margin, (uint8_t *)scratch);
    for (size_t i = 0; i < n; i++)
        out->lit += lit[i];
}

void rec_photo_apply(float *img, int32_t bw, int32_t bh, int nch, const float *background,
                     const float gain[3], const struct rec_photo_params *p, float *weight,
                     uint8_t *lit, float *scratch, struct rec_photo_stats *out)
{
    *out = (struct rec_photo_stats){0};
    if (nch == 3)
        apply(img, bw, bh, 4, NULL, NULL, background, gain, p, weight, lit, scratch, NULL, out);
    else
        apply(img, bw, bh, 1, NULL, NULL, background, gain, p, weight, lit, scratch, NULL, out);
    finish(bw, bh, p, lit, scratch, out);
}

void rec_photo_apply_mosaic(float *img, int32_t bw, int32_t bh, const uint8_t cell[4],
                            const float *background, const float gain[3],
                            const struct rec_photo_params *p, float *weight, uint8_t *lit,
                            float *scratch, float *plane, struct rec_photo_stats *out)
{
    *out = (struct rec_photo_stats){0};
    apply(img, bw, bh, 4, cell, &rec_grain_mosaic, background, gain, p, weight, lit, scratch, plane,
          out);
    finish(bw, bh, p, lit, scratch, out);
}

void rec_photo_apply_bayer(float *img, int32_t bw, int32_t bh, int32_t binning,
                           const float *background, const float gain[3],
                           const struct rec_photo_params *p, float *weight, uint8_t *lit,
                           float *scratch, struct rec_photo_stats *out)
{
    const struct rec_grain grain = rec_grain_bayer(binning);
    *out = (struct rec_photo_stats){0};
    apply(img, bw, bh, 4, NULL, &grain, background, gain, p, weight, lit, scratch, NULL, out);
    finish(bw, bh, p, lit, scratch, out);
}
