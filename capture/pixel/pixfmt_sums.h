/* pixfmt_sums.h - bins integer samples of any depth, except Bayer images.
 *
 * For a piece of a row of bins, it sums down the columns first, then across.  While the binning has a factor of 2,
 * it adds neighbours in pairs. */
#ifndef CAP_PIXFMT_SUMS_H
#define CAP_PIXFMT_SUMS_H
#include "capture/pixel/pixfmt_finish.h"
#include "capture/pixel/pixfmt_unpack.h"

enum {
    SAMPLES = 1152, /* of a row at a time: all of one plane, or a third for each of three planes */
    THIRD = SAMPLES / 3,
};

/* Sums and greatest samples of planes; plane c starts at c*(THIRD + CAP_PIX_SLACK). */
enum { PITCH = THIRD + CAP_PIX_SLACK };
struct sums {
    uint32_t sum[3 * PITCH];
    uint16_t top[3 * PITCH];
};

static void greatest(const uint16_t *restrict s, int32_t n, uint16_t *restrict top)
{
    for (int32_t i = 0; i < n; i++)
        top[i] = top[i] > s[i] ? top[i] : s[i];
}

static void pixfmt_sums_add(const uint16_t *restrict s, const uint32_t *table, int32_t n,
                            uint32_t *restrict sum)
{
    if (table != NULL)
        for (int32_t i = 0; i < n; i++)
            sum[i] += table[s[i]];
    else
        for (int32_t i = 0; i < n; i++)
            sum[i] += s[i];
}

static void add16(const uint16_t *restrict s, int32_t n, uint16_t *restrict sum)
{
    for (int32_t i = 0; i < n; i++)
        sum[i] = (uint16_t)(sum[i] + s[i]);
}

/* Rows y .. y+binning-1, pixels [x, x+n). */
static void pixfmt_sums_down(const struct cap_pix *j, int32_t y, int32_t x, int32_t n,
                             struct sums *c)
{
    uint16_t s[3 * PITCH];
    pix_row(j, y, x, n, c->top, PITCH);
    for (size_t k = 0; k < (size_t)j->samples; k++)
        cap_pix_light(c->top + k * PITCH, j->table, n, c->sum + k * PITCH);
    for (int r = 1; r < j->binning; r++) {
        pix_row(j, y + r, x, n, s, PITCH);
        for (size_t k = 0; k < (size_t)j->samples; k++) {
            pixfmt_sums_add(s + k * PITCH, j->table, n, c->sum + k * PITCH);
            greatest(s + k * PITCH, n, c->top + k * PITCH);
        }
    }
}

/* The same where sums of samples fit 16 bits. */
static void down16(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, struct sums *c)
{
    uint16_t s[3 * PITCH], sum[3 * PITCH];
    pix_row(j, y, x, n, c->top, PITCH);
    for (size_t k = 0; k < (size_t)j->samples; k++)
        memcpy(sum + k * PITCH, c->top + k * PITCH, (size_t)n * sizeof *sum);
    for (int r = 1; r < j->binning; r++) {
        pix_row(j, y + r, x, n, s, PITCH);
        for (size_t k = 0; k < (size_t)j->samples; k++) {
            add16(s + k * PITCH, n, sum + k * PITCH);
            greatest(s + k * PITCH, n, c->top + k * PITCH);
        }
    }
    for (size_t k = 0; k < (size_t)j->samples; k++)
        cap_pix_light(sum + k * PITCH, NULL, n, c->sum + k * PITCH);
}

/* Sums and greatest of n bytes in `rows` rows. */
static void add_bytes(const uint8_t *p, ptrdiff_t pitch, int rows, int32_t n,
                      uint16_t *restrict sum, uint8_t *restrict top)
{
    for (int32_t i = 0; i < n; i++)
        sum[i] = p[i];
    memcpy(top, p, (size_t)n);
    for (int r = 1; r < rows; r++) {
        const uint8_t *restrict q = p + r * pitch;
        for (int32_t i = 0; i < n; i++)
            sum[i] = (uint16_t)(sum[i] + q[i]);
        for (int32_t i = 0; i < n; i++)
            top[i] = top[i] > q[i] ? top[i] : q[i];
    }
}

/* The same for linear bytes: RGB become planes after the sum. */
static void down8(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, struct sums *c)
{
    uint16_t sum[SAMPLES];
    uint8_t top[SAMPLES];
    const uint8_t *p = (const uint8_t *)j->img.data + y * j->img.stride + (ptrdiff_t)x * j->samples;
    add_bytes(p, j->img.stride, j->binning, n * j->samples, sum, top);
    if (j->samples == 1) {
        cap_pix_light(sum, NULL, n, c->sum);
        for (int32_t i = 0; i < n; i++)
            c->top[i] = top[i];
        return;
    }
    for (size_t k = 0; k < 3; k++) {
        uint32_t *restrict s = c->sum + (j->swapped ? 2 - k : k) * PITCH;
        uint16_t *restrict t = c->top + (j->swapped ? 2 - k : k) * PITCH;
        for (size_t i = 0; i < (size_t)n; i++)
            /* NOLINTNEXTLINE(clang-analyzer-core.uninitialized.Assign): add_bytes wrote 3 n of them */
            s[i] = sum[i * 3 + k];
        for (size_t i = 0; i < (size_t)n; i++)
            t[i] = top[i * 3 + k];
    }
}

static void pixfmt_sums_pairs(const uint32_t *restrict sum, const uint16_t *restrict top, int32_t n,
                              uint32_t *restrict sum2, uint16_t *restrict top2)
{
    for (int32_t i = 0; i < n; i++)
        sum2[i] = sum[2 * i] + sum[2 * i + 1];
    for (int32_t i = 0; i < n; i++)
        top2[i] = top[2 * i] > top[2 * i + 1] ? top[2 * i] : top[2 * i + 1];
}

CAP_PIX_INLINE void groups(const uint32_t *restrict sum, const uint16_t *restrict top, int b,
                           int32_t n, uint32_t *restrict sums, uint16_t *restrict tops)
{
    for (int32_t i = 0; i < n; i++) {
        uint32_t s = 0;
        uint16_t t = 0;
        for (int k = 0; k < b; k++) {
            s += sum[i * b + k];
            t = top[i * b + k] > t ? top[i * b + k] : t;
        }
        sums[i] = s;
        tops[i] = t;
    }
}

/* Sum plane c of `from`, n columns, to bins.  Works in both buffers; returns the one with the result. */
static struct sums *pixfmt_sums_across(int b, int32_t n, size_t c, struct sums *from,
                                       struct sums *to)
{
    size_t at = c * PITCH;
    for (; b % 2 == 0; b /= 2) {
        struct sums *t = from;
        n /= 2;
        pixfmt_sums_pairs(from->sum + at, from->top + at, n, to->sum + at, to->top + at);
        from = to;
        to = t;
    }
    if (b == 1)
        return from;
    if (b == 3)
        groups(from->sum + at, from->top + at, 3, n / 3, to->sum + at, to->top + at);
    else if (b == 5)
        groups(from->sum + at, from->top + at, 5, n / 5, to->sum + at, to->top + at);
    else
        groups(from->sum + at, from->top + at, b, n / b, to->sum + at, to->top + at);
    return to;
}

static void pixfmt_sums_bins_of(const struct cap_pix *j, int32_t Y, int32_t x, int32_t n,
                                float *out)
{
    struct sums a, b, *done = NULL;
    const float scale = cap_pix_scale(j, j->binning * j->binning);
    struct cap_pix_bins v = {.sum = {NULL}};
    if (j->binning > 1 && j->table == NULL && j->full == 255)
        down8(j, Y * j->binning, x, n, &a);
    else if (j->binning > 2 && j->table == NULL && j->full * (unsigned)j->binning <= UINT16_MAX)
        down16(j, Y * j->binning, x, n, &a);
    else
        pixfmt_sums_down(j, Y * j->binning, x, n, &a);
    for (size_t c = 0; c < (size_t)j->samples; c++) {
        done = pixfmt_sums_across(j->binning, n, c, &a, &b);
        v.sum[c] = done->sum + c * PITCH;
        v.top[c] = done->top + c * PITCH;
        v.scale[c][0] = v.scale[c][1] = scale;
    }
    pix_finish(j, &v, n / j->binning, out);
}

static void pix_sums(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    int32_t b = j->binning, w = j->img.width, bw = w / b;
    int32_t unit = b % 4 == 0 ? b : b % 2 == 0 ? 2 * b : 4 * b; /* whole bins and whole fours */
    int32_t piece = (j->samples == 1 ? SAMPLES : THIRD) / unit * unit;
    size_t cs = j->nch == 3 ? 4 : 1;
    for (int32_t Y = y0; Y < y1; Y++)
        for (int32_t x = 0; x < w; x += piece) {
            int32_t n = w - x < piece ? w - x : piece;
            pixfmt_sums_bins_of(j, Y, x, n, out + ((size_t)Y * (size_t)bw + (size_t)(x / b)) * cs);
        }
}
#endif
