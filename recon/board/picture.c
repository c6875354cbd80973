/* The present picture: its levels, their range and their noise, and its 8-bit form for OpenCV. */
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/board/detect_int.h"

static pvx_err picture_room(rec_board_detector *det, size_t pixels)
{
    if (pixels <= det->size)
        return PVX_OK;
    det->size = 0;
    free(det->level);
    free(det->grey);
    det->level = pvx_calloc(pixels, sizeof *det->level);
    det->grey = pvx_calloc(pixels, 1);
    if (det->level == NULL || det->grey == NULL)
        return PVX_ENOMEM;
    det->size = pixels;
    return PVX_OK;
}

static void picture_read_levels(rec_board_detector *det, const struct rec_board_picture *p)
{
    float of_byte[256];
    for (int i = 0; i < 256; i++)
        of_byte[i] = (float)i / 255;
    for (int32_t v = 0; v < p->height; v++) {
        const char *row = (const char *)p->data + v * p->stride;
        float *to = det->level + (size_t)v * (size_t)p->width;
        for (int32_t u = 0; u < p->width; u++) {
            float x = p->is_float ? ((const float *)row)[u] : of_byte[((const uint8_t *)row)[u]];
            to[u] = x > 0 ? (x < 16 ? x : 16) : 0; /* NaN too */
        }
    }
    det->field = (struct rec_field){det->level, p->width, p->height};
}

/* Standard deviation of the noise, from a part of the pixels: the median of the second difference along both axes,
 * to which edges and slopes add little (Immerkaer, CVIU 64:300, 1996). */
static double picture_noise(rec_board_detector *det)
{
    enum { BINS = 4096 };
    uint32_t h[BINS] = {0};
    ptrdiff_t w = det->field.width, step = 1 + w * det->field.height / 100000;
    size_t n = 0, below = 0, at = 0;
    for (ptrdiff_t i = w + 1; i < w * det->field.height - w - 1; i += step) {
        const float *p = det->level + i;
        float d = p[-w - 1] + p[-w + 1] + p[w - 1] + p[w + 1] - 2 * (p[-w] + p[w] + p[-1] + p[1]) +
                  4 * p[0];
        h[(int)fminf(fabsf(d) * BINS, BINS - 1)]++; /* full scale: beyond any noise */
        n++;
    }
    while (at < BINS - 1 && below + h[at] <= n / 2)
        below += h[at++];
    return ((double)at + 0.5) / BINS / (6 * 0.6745);
}

/* The levels with 0.5 % of the pixels below and above, from a histogram of the square root, which has fine bins
 * for dim pictures. */
static void find_range(rec_board_detector *det)
{
    enum { BINS = 4096 };
    uint32_t h[BINS] = {0};
    size_t n = (size_t)det->field.width * (size_t)det->field.height, lo = 0, hi = 0, at;
    for (size_t i = 0; i < n; i++)
        h[(int)(sqrtf(det->level[i] / 16) * (BINS - 1))]++;
    for (at = 0; at < BINS - 1 && lo + h[at] <= n / 200; at++)
        lo += h[at];
    det->low = 16.0 * (double)(at * at) / ((BINS - 1.0) * (BINS - 1.0));
    for (at = BINS - 1; at > 0 && hi + h[at] <= n / 200; at--)
        hi += h[at];
    det->high = 16.0 * (double)((at + 1) * (at + 1)) / ((BINS - 1.0) * (BINS - 1.0));
    det->range = det->high - det->low;
    det->noise = picture_noise(det);
    det->high = fmax(det->high, det->low + 30 * det->noise); /* else noise alone would make edges */
}

/* 8 bits for OpenCV: full range; inverted boards are inverted back. */
static void make_grey(rec_board_detector *det)
{
    size_t n = (size_t)det->field.width * (size_t)det->field.height;
    bool inverted = det->print[0].board.inverted;
    float scale = (float)(255 / fmax(det->high - det->low, 1e-6)), low = (float)det->low;
    for (size_t i = 0; i < n; i++) {
        float x = (det->level[i] - low) * scale;
        x = x > 0 ? (x < 255 ? x : 255) : 0;
        det->grey[i] = (uint8_t)(inverted ? 255.5F - x : x + 0.5F);
    }
    for (size_t i = 0; inverted && i < n; i++)
        det->level[i] = -det->level[i];
}

void rec_board_turn(rec_board_detector *det, bool flipped)
{
    if (det->flipped == flipped)
        return;
    det->flipped = flipped;
    size_t w = (size_t)det->field.width;
    for (int32_t v = 0; v < det->field.height; v++) {
        float *f = det->level + (size_t)v * w;
        uint8_t *g = det->grey + (size_t)v * w;
        for (size_t u = 0; u < w / 2; u++) {
            float keep = f[u];
            uint8_t kept = g[u];
            f[u] = f[w - 1 - u];
            f[w - 1 - u] = keep;
            g[u] = g[w - 1 - u];
            g[w - 1 - u] = kept;
        }
    }
}

pvx_err rec_board_read(rec_board_detector *det, const struct rec_board_picture *p)
{
    PVX_TRY(picture_room(det, (size_t)p->width * (size_t)p->height));
    det->flipped = false;
    picture_read_levels(det, p);
    find_range(det);
    make_grey(det);
    return PVX_OK;
}
