/* pixfmt_sums.c - binning of integer samples of any depth: unpack a piece of a raw row, add it to the
 * sums of its bins' columns, then add across.  All but the unpacking are plain loops over 32-bit words
 * that vectorise; a piece stays in the first-level cache. */
#include "capture/pixfmt_priv.h"

enum { SAMPLES = 768 }; /* of a row at a time: pixels or thirds of them */

/* Column sums of raw rows: sum [n], and sat [n] != 0 where any sample was saturated. */
struct columns {
    uint32_t sum[SAMPLES + 1], sat[SAMPLES + 1]; /* +1: whole vectors are read at the last pixel */
};

static void add_row(const struct cap_pix *j, const uint16_t *restrict s, size_t n, bool first,
                    struct columns *restrict c)
{
    const uint32_t *table = j->table;
    const uint32_t full = j->full;
    uint32_t light[SAMPLES];
    if (table != NULL)
        for (size_t i = 0; i < n; i++)
            light[i] = table[s[i] < full ? s[i] : full];
    if (first && table == NULL)
        for (size_t i = 0; i < n; i++) {
            c->sum[i] = s[i];
            c->sat[i] = s[i] >= full;
        }
    else if (first)
        for (size_t i = 0; i < n; i++) {
            c->sum[i] = light[i];
            c->sat[i] = s[i] >= full;
        }
    else if (table == NULL)
        for (size_t i = 0; i < n; i++) {
            c->sum[i] += s[i];
            c->sat[i] |= s[i] >= full;
        }
    else
        for (size_t i = 0; i < n; i++) {
            c->sum[i] += light[i];
            c->sat[i] |= s[i] >= full;
        }
}

/* Rows y .. y+rows-1, pixels [x, x+n). */
static void add_rows(const struct cap_pix *j, int32_t y, int rows, int32_t x, int32_t n,
                     struct columns *c)
{
    uint16_t s[SAMPLES];
    for (int r = 0; r < rows; r++) {
        cap_pix_row(j, y + r, x, n, s);
        add_row(j, s, (size_t)(n * j->samples), r == 0, c);
    }
}

CAP_PIX_INLINE cap_i4 four(const uint32_t *p)
{
    return *(const cap_i4 *)p;
}

/* Bins of RGB to 4 lanes. */
CAP_PIX_INLINE void across_rgb(const struct columns *c, int b, int32_t bins, float scale,
                               float *out)
{
    const cap_i4 lanes = {-1, -1, -1, 0};
    const cap_f4 one = {1, 1, 1, 1};
    for (int32_t X = 0; X < bins; X++) {
        cap_i4 s = {0}, m = {0};
        for (int i = 0; i < b; i++) {
            s += four(c->sum + (X * b + i) * 3);
            m |= four(c->sat + (X * b + i) * 3);
        }
        cap_i4 bad = m != 0;
        cap_f4 v = __builtin_convertvector(s, cap_f4) * scale;
        *(cap_f4 *)(out + (size_t)X * 4) =
            (cap_f4)((((cap_i4)one & bad) | ((cap_i4)v & ~bad)) & lanes);
    }
}

CAP_PIX_INLINE void across_grey(const struct columns *c, int b, int32_t bins, float scale,
                                float *restrict out)
{
    for (int32_t X = 0; X < bins; X++) {
        uint32_t s = 0, m = 0;
        for (int i = 0; i < b; i++) {
            s += c->sum[X * b + i];
            m |= c->sat[X * b + i];
        }
        float v = (float)(int32_t)s * scale;
        out[X] = m != 0 ? 1.0f : v;
    }
}

/* The rest: grey to 3 lanes, colour to one. */
static void across_any(const struct cap_pix *j, const struct columns *c, int32_t bins, float scale,
                       float *out)
{
    int b = j->binning;
    for (int32_t X = 0; X < bins; X++) {
        float rgb[3] = {0};
        bool saturated[3] = {false};
        for (int k = 0; k < j->samples; k++) {
            uint32_t s = 0, m = 0;
            for (int i = 0; i < b; i++) {
                s += c->sum[(X * b + i) * j->samples + k];
                m |= c->sat[(X * b + i) * j->samples + k];
            }
            saturated[k] = m != 0;
            rgb[k] = m != 0 ? 1.0f : (float)(int32_t)s * scale;
        }
        cap_pix_put(out + X * (j->nch == 3 ? 4 : 1), rgb, saturated, j->grey, j->nch);
    }
}

static void bins_of(const struct cap_pix *j, int32_t Y, int32_t x, int32_t n, float *out)
{
    struct columns c;
    int b = j->binning;
    int32_t bins = n / b;
    float scale = cap_pix_scale(j, b * b);
    add_rows(j, Y * b, b, x, n, &c);
    c.sum[n * j->samples] = c.sat[n * j->samples] = 0;
    if (j->grey != (j->nch == 1)) {
        across_any(j, &c, bins, scale, out);
    } else if (j->grey) {
        if (b == 2)
            across_grey(&c, 2, bins, scale, out);
        else if (b == 4)
            across_grey(&c, 4, bins, scale, out);
        else
            across_grey(&c, b, bins, scale, out);
    } else if (b == 2) {
        across_rgb(&c, 2, bins, scale, out);
    } else if (b == 4) {
        across_rgb(&c, 4, bins, scale, out);
    } else {
        across_rgb(&c, b, bins, scale, out);
    }
}

typedef uint16_t four16 __attribute__((vector_size(8), aligned(2), may_alias));

/* Binning 1: each sample is its own sum. */
static void one_to_one(const struct cap_pix *j, int32_t y, int32_t x, int32_t n, float *out)
{
    uint16_t s[SAMPLES + 1]; /* +1: whole vectors are read at the last pixel */
    s[n * j->samples] = 0;
    const uint32_t full = j->full, *table = j->table;
    const float scale = cap_pix_scale(j, 1);
    cap_pix_row(j, y, x, n, s);
    if (j->grey && table == NULL) {
        for (int32_t i = 0; i < n; i++)
            out[i] = s[i] >= full ? 1.0f : (float)(int32_t)s[i] * scale;
    } else if (j->grey) {
        for (int32_t i = 0; i < n; i++)
            out[i] = s[i] >= full ? 1.0f : (float)(int32_t)table[s[i]] * scale;
    } else {
        const cap_f4 one = {1, 1, 1, 1};
        const cap_i4 lanes = {-1, -1, -1, 0};
        const cap_i4 most = {(int32_t)full, (int32_t)full, (int32_t)full, 1};
        for (int32_t i = 0; i < n; i++) {
            const uint16_t *p = s + i * 3;
            cap_i4 raw = __builtin_convertvector(*(const four16 *)p, cap_i4) & lanes;
            cap_i4 bad = raw >= most, v = raw;
            if (table != NULL)
                v = (cap_i4){(int32_t)table[p[0] < full ? p[0] : full],
                             (int32_t)table[p[1] < full ? p[1] : full],
                             (int32_t)table[p[2] < full ? p[2] : full], 0};
            cap_f4 light = __builtin_convertvector(v, cap_f4) * scale;
            *(cap_f4 *)(out + (size_t)i * 4) =
                (cap_f4)(((cap_i4)one & bad) | ((cap_i4)light & ~bad));
        }
    }
}

void cap_pix_sums(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    int32_t b = j->binning, w = j->img.width, bw = w / b;
    int32_t unit = b % 4 == 0 ? b : b % 2 == 0 ? 2 * b : 4 * b; /* whole bins and whole fours */
    int32_t piece = SAMPLES / j->samples / unit * unit;
    size_t cs = j->nch == 3 ? 4 : 1;
    for (int32_t Y = y0; Y < y1; Y++)
        for (int32_t x = 0; x < w; x += piece) {
            int32_t n = w - x < piece ? w - x : piece;
            float *o = out + ((size_t)Y * (size_t)bw + (size_t)(x / b)) * cs;
            if (b == 1 && j->grey == (j->nch == 1))
                one_to_one(j, Y, x, n, o);
            else
                bins_of(j, Y, x, n, o);
        }
}
