#include "recon/carve/photo_mosaic.h"

#define BLOCK  REC_PHOTO_BLOCK
#define BLOCKS REC_PHOTO_BLOCKS

struct rec_grain rec_grain_bayer(int32_t binning)
{
    if (binning == 1)
        return (struct rec_grain){4, {1.5f, 2.23f, 1.5f, 1}, {2.94f, 4.39f, 2.94f, 1}};
    float b = (float)binning, a = 8 * b - 6, near = 9 * a / (24 * b - 6),
          wide = 49 * a / (56 * b - 6);
    return (struct rec_grain){2, {near, 3, near, 1}, {wide, 7, wide, 1}};
}

struct block {
    rec_f4 mean, noise2, at_low;
};

static rec_f4 ones(rec_i4 lane)
{
    return rec_select(lane, rec_splat(1), (rec_f4){0});
}

/* As photo.c's measure_block, with the second difference over bins two apart: they have one colour.
 * true: every channel has enough of them. */
static bool measure_block(const float *img, int32_t bw, int32_t bh, const uint8_t cell[4],
                          const float *weight, int32_t x0, int32_t y0, rec_f4 low,
                          struct block *out)
{
    int32_t x1 = x0 + BLOCK < bw ? x0 + BLOCK : bw, y1 = y0 + BLOCK < bh ? y0 + BLOCK : bh;
    rec_f4 mean = {0}, d2 = {0}, at_low = {0}, bins = {0, 0, 0, 1}, cells = {0, 0, 0, 4};
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = x0; x < x1; x++) {
            size_t i = (size_t)y * (size_t)bw + (size_t)x, j = i + 2 * (size_t)bw;
            rec_i4 lane = rec_mosaic_lane(cell, x, y);
            if (weight[i] == 0)
                continue;
            rec_f4 a = rec_ld(img, i, 4);
            mean += a;
            at_low += ones((a <= low) & lane);
            bins += ones(lane);
            if (x + 2 >= x1 || y + 2 >= y1 || weight[i + 2] == 0 || weight[j] == 0 ||
                weight[j + 2] == 0)
                continue;
            rec_f4 d = (a - rec_ld(img, i + 2, 4)) - (rec_ld(img, j, 4) - rec_ld(img, j + 2, 4));
            d2 += d * d;
            cells += ones(lane);
        }
    if (!rec_all(cells >= 4))
        return false;
    out->mean = mean / bins;
    out->noise2 = d2 / (rec_splat(4) * cells);
    out->at_low = at_low / bins;
    return true;
}

void rec_mosaic_noise(const float *img, int32_t bw, int32_t bh, const uint8_t cell[4],
                      const float *weight, rec_f4 low, float sigma[3], float dark[3])
{
    float mean[3][BLOCKS], noise2[3][BLOCKS], at_low[3][BLOCKS], sorted[BLOCKS];
    int32_t across = (bw + BLOCK - 1) / BLOCK, down = (bh + BLOCK - 1) / BLOCK, n = 0;
    int32_t every = (int32_t)(((int64_t)across * down + BLOCKS - 1) / BLOCKS);
    for (int32_t k = 0; k < across * down; k += every) {
        struct block b;
        if (!measure_block(img, bw, bh, cell, weight, k % across * BLOCK, k / across * BLOCK, low,
                           &b))
            continue;
        for (int c = 0; c < 3; c++) {
            mean[c][n] = b.mean[c];
            noise2[c][n] = b.noise2[c];
            at_low[c][n] = b.at_low[c];
        }
        n++;
    }
    for (int c = 0; c < 3; c++)
        sigma[c] =
            n == 0 ? 0 : rec_photo_dark_noise(mean[c], noise2[c], at_low[c], n, sorted, &dark[c]);
}

void rec_mosaic_plane(const float *img, int32_t bw, int32_t bh, float *plane)
{
    const rec_f4 scale = {4.0f / 16, 2.0f / 16, 4.0f / 16, 0}, two = rec_splat(2);
    size_t w = (size_t)bw;
    for (int32_t y = 0; y < bh; y++) {
        const float *mid = img + (size_t)y * w * 4;
        const float *up = img + (size_t)(y > 0 ? y - 1 : 1) * w * 4;
        const float *down = img + (size_t)(y + 1 < bh ? y + 1 : bh - 2) * w * 4;
        float *out = plane + (size_t)y * w * 4;
        /* sums down three rows: left of x, at x, right of x */
        rec_f4 at = rec_ld(up, 0, 4) + two * rec_ld(mid, 0, 4) + rec_ld(down, 0, 4);
        rec_f4 left = rec_ld(up, 1, 4) + two * rec_ld(mid, 1, 4) + rec_ld(down, 1, 4);
        for (size_t x = 0; x < w; x++) {
            size_t r = x + 1 < w ? x + 1 : w - 2;
            rec_f4 right = rec_ld(up, r, 4) + two * rec_ld(mid, r, 4) + rec_ld(down, r, 4);
            rec_st(out, x, 4, scale * (left + two * at + right));
            left = at;
            at = right;
        }
    }
}
