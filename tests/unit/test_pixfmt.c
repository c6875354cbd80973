/* test_pixfmt.c - every format and binning against a readable reference, bit by bit. */
#include "../t.h"

#include <stdbool.h>

#include "capture/pixfmt.h"

enum { W = 48, H = 32, PAD = 7 };

struct sample {
    double value;
    bool saturated, finite;
};

static int colour_of(enum cap_pixfmt f, int x, int y)
{
    const char *pattern = cap_pixfmt_name(f) + 5; /* "BayerRG8" */
    char c = pattern[x & 1];
    if (y & 1) /* the second row holds the other colours: under R is G, under G the missing one */
        c = pattern[x & 1] == 'G' ? (strchr(pattern, 'R') != NULL ? 'B' : 'R') : 'G';
    return c == 'R' ? 0 : c == 'G' ? 1 : 2;
}

static bool is_bayer(enum cap_pixfmt f)
{
    return f >= CAP_BAYER_RG8 && f <= CAP_BAYER_BG8;
}

static double full_of(enum cap_pixfmt f)
{
    return f == CAP_GREY16 || f == CAP_RGB16       ? 65535
           : f == CAP_GREY_F32 || f == CAP_RGB_F32 ? 0
                                                   : 255;
}

/* Sample s of pixel (x,y). */
static struct sample sample_at(const struct cap_image *img, int x, int y, int s)
{
    const char *p = (const char *)img->data + y * img->stride;
    double full = full_of(img->fmt);
    int per = is_bayer(img->fmt) ? 1 : cap_pixfmt_channels(img->fmt);
    struct sample out = {.finite = true};
    if (full == 255)
        out.value = ((const uint8_t *)p)[x * per + s];
    else if (full == 65535) {
        uint16_t v;
        memcpy(&v, p + (x * per + s) * 2, 2);
        out.value = v;
    } else {
        float v;
        memcpy(&v, p + (x * per + s) * 4, 4);
        out.value = v;
        out.finite = isfinite(v);
    }
    out.saturated = full > 0 && out.value == full;
    return out;
}

/* Channel c of bin (X,Y): all its samples, in the order of the header's words. */
static float channel(const struct cap_image *img, int b, int X, int Y, int c, bool *saturated)
{
    double sum = 0;
    int n = 0;
    *saturated = false;
    for (int y = Y * b; y < (Y + 1) * b; y++)
        for (int x = X * b; x < (X + 1) * b; x++) {
            if (is_bayer(img->fmt) && colour_of(img->fmt, x, y) != c)
                continue;
            struct sample s = sample_at(img, x, y, is_bayer(img->fmt) ? 0 : c);
            *saturated |= s.saturated;
            if (s.finite) {
                sum += s.value;
                n++;
            }
        }
    if (*saturated)
        return 1;
    if (n == 0)
        return NAN;
    double full = full_of(img->fmt);
    return full > 0 ? (float)sum * (1.0f / ((float)n * (float)full)) : (float)(sum / n);
}

static int mirrored(int i, int n)
{
    return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i;
}

/* Binning 1 of a Bayer image: own colour, else the mean of that colour's samples among the 8
 * neighbours, the image continued by mirroring. */
static float demosaic(const struct cap_image *img, int X, int Y, int c, bool *saturated)
{
    double sum = 0;
    int n = 0;
    *saturated = false;
    bool own = colour_of(img->fmt, X, Y) == c;
    for (int y = Y - 1; y <= Y + 1; y++)
        for (int x = X - 1; x <= X + 1; x++) {
            int mx = mirrored(x, img->width), my = mirrored(y, img->height);
            if (colour_of(img->fmt, mx, my) != c || (own && (x != X || y != Y)))
                continue;
            struct sample s = sample_at(img, mx, my, 0);
            *saturated |= s.saturated;
            sum += s.value;
            n++;
        }
    return *saturated ? 1 : (float)sum * (1.0f / ((float)n * 255.0f));
}

static void reference(const struct cap_image *img, int b, int nch, float *out)
{
    int bw = img->width / b, bh = img->height / b;
    bool grey = cap_pixfmt_channels(img->fmt) == 1;
    for (int Y = 0; Y < bh; Y++)
        for (int X = 0; X < bw; X++) {
            float v[3] = {0};
            bool sat[3] = {false};
            for (int c = 0; c < (grey ? 1 : 3); c++)
                v[c] = is_bayer(img->fmt) && b == 1 ? demosaic(img, X, Y, c, &sat[c])
                                                    : channel(img, b, X, Y, c, &sat[c]);
            float *o = out + (Y * bw + X) * (nch == 3 ? 4 : 1);
            if (nch == 3) {
                for (int c = 0; c < 3; c++)
                    o[c] = grey ? v[0] : v[c];
                o[3] = 0;
            } else if (grey) {
                o[0] = v[0];
            } else if (sat[0] || sat[1] || sat[2]) {
                o[0] = 1;
            } else {
                float sum = 0;
                int n = 0;
                for (int c = 0; c < 3; c++)
                    if (isfinite(v[c])) {
                        sum += v[c];
                        n++;
                    }
                o[0] = n == 3 ? sum * (1.0f / 3.0f) : n > 0 ? sum / (float)n : NAN;
            }
        }
}

/* Random image of the format, an exact-size block so that a sanitizer sees an over-read. */
static void *make(enum cap_pixfmt f, int w, int h, int pad, struct cap_image *img)
{
    size_t row = cap_pixfmt_row(f, w);
    *img = (struct cap_image){.width = w, .height = h, .fmt = f, .stride = (ptrdiff_t)row + pad};
    img->size = (size_t)img->stride * (size_t)(h - 1) + row;
    char *data = malloc(img->size);
    for (size_t i = 0; i < img->size; i++)
        data[i] = (char)(t_rand() >> 40);
    if (full_of(f) == 0)
        for (int y = 0; y < h; y++)
            for (size_t i = 0; i < row / 4; i++) {
                float v = (float)t_uniform(-0.5, 3);
                uint64_t dice = t_rand() >> 60;
                v = dice == 0 ? NAN : dice == 1 ? INFINITY : v;
                memcpy(data + y * img->stride + i * 4, &v, 4);
            }
    img->data = data;
    return data;
}

static bool same(const float *a, const float *b, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (memcmp(&a[i], &b[i], 4) != 0 && !(isnan(a[i]) && isnan(b[i]))) {
            printf("  at %zu: %.9g, want %.9g\n", i, a[i], b[i]);
            return false;
        }
    return true;
}

static void matches_the_reference(void)
{
    static const int bins[] = {1, 2, 3, 4, 8, 16};
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        for (size_t k = 0; k < sizeof bins / sizeof bins[0]; k++)
            for (int nch = 1; nch <= 3; nch += 2) {
                int b = bins[k], w = b == 3 ? 45 : W, h = b == 3 ? 33 : H;
                struct cap_image img;
                void *mem = make(f, w, h, b == 4 ? 0 : PAD, &img);
                size_t n = (size_t)(w / b) * (size_t)(h / b) * (nch == 3 ? 4 : 1);
                float *want = malloc(n * 4), *got = malloc(n * 4);
                reference(&img, b, nch, want);
                int mid = h / b / 2;
                T_EQ_I(cap_bin(&img, b, nch, 0, mid, got), PVX_OK);
                T_EQ_I(cap_bin(&img, b, nch, mid, h / b, got), PVX_OK);
                T_CHECK_(same(got, want, n), "%s binning %d, %d channels", cap_pixfmt_name(f), b,
                         nch);
                free(want);
                free(got);
                free(mem);
            }
}

/* Rows longer than the block that the fast path works in, and widths that end inside one. */
static void wide_rows(void)
{
    static const enum cap_pixfmt formats[] = {CAP_RGB8, CAP_GREY8, CAP_BAYER_RG8, 0};
    static const int widths[] = {512, 516, 1536, 1540, 2044};
    for (size_t f = 0; f < 3; f++)
        for (size_t i = 0; i < 5; i++)
            for (int b = 2; b <= 4; b += 2) {
                struct cap_image img;
                void *mem = make(formats[f], widths[i], 8, 1, &img);
                size_t n = (size_t)(widths[i] / b) * (size_t)(8 / b) * 4;
                float *want = malloc(n * 4), *got = malloc(n * 4);
                reference(&img, b, 3, want);
                T_EQ_I(cap_bin(&img, b, 3, 0, 8 / b, got), PVX_OK);
                T_CHECK_(same(got, want, n), "%s %d wide", cap_pixfmt_name(formats[f]), widths[i]);
                free(want);
                free(got);
                free(mem);
            }
}

static void one_saturated_sample_shows(void)
{
    uint8_t px[4 * 4 * 3];
    memset(px, 10, sizeof px);
    px[(1 * 4 + 2) * 3 + 1] = 255;
    struct cap_image img = {px, sizeof px, 4, 4, 12, CAP_RGB8, 0};
    float out[4];
    T_EQ_I(cap_bin(&img, 4, 3, 0, 1, out), PVX_OK);
    T_NEAR(out[0], 10.0 / 255, 1e-7);
    T_OK(out[1] == 1.0f);
    T_NEAR(out[2], 10.0 / 255, 1e-7);
    T_EQ_I(cap_bin(&img, 4, 1, 0, 1, out), PVX_OK);
    T_OK(out[0] == 1.0f);
    memset(px, 255, sizeof px);
    T_EQ_I(cap_bin(&img, 1, 3, 0, 4, (float[64]){0}), PVX_OK);
    float grey[16];
    struct cap_image mono = {px, 16, 4, 4, 4, CAP_GREY8, 0};
    T_EQ_I(cap_bin(&mono, 1, 1, 0, 4, grey), PVX_OK);
    T_OK(grey[15] == 1.0f);
}

static void not_finite_samples_are_left_out(void)
{
    float px[4] = {NAN, 0.25f, INFINITY, 2.75f}, out[1];
    struct cap_image img = {px, sizeof px, 2, 2, 8, CAP_GREY_F32, 0};
    T_EQ_I(cap_bin(&img, 2, 1, 0, 1, out), PVX_OK);
    T_OK(out[0] == 1.5f); /* floats do not saturate */
    px[1] = px[3] = -INFINITY;
    T_EQ_I(cap_bin(&img, 2, 1, 0, 1, out), PVX_OK);
    T_OK(isnan(out[0]));
}

static void refuses(void)
{
    uint8_t px[64] = {0};
    float out[64];
    struct cap_image ok = {px, 64, 8, 8, 8, CAP_GREY8, 0}, bad = ok;
    T_EQ_I(cap_bin(&ok, 2, 1, 0, 4, out), PVX_OK);
    bad.size = 63;
    T_EQ_I(cap_bin(&bad, 2, 1, 0, 4, out), PVX_EFORMAT);
    bad = ok;
    bad.stride = 7;
    T_EQ_I(cap_bin(&bad, 2, 1, 0, 4, out), PVX_EINVAL);
    bad.stride = -8;
    T_EQ_I(cap_bin(&bad, 2, 1, 0, 4, out), PVX_EINVAL);
    bad = ok;
    bad.fmt = CAP_FMT_NONE;
    T_EQ_I(cap_bin(&bad, 2, 1, 0, 4, out), PVX_EUNSUP);
    bad.fmt = (enum cap_pixfmt)99;
    T_EQ_I(cap_bin(&bad, 2, 1, 0, 4, out), PVX_EUNSUP);
    T_EQ_I(cap_bin(&ok, 3, 1, 0, 1, out), PVX_EINVAL);
    T_EQ_I(cap_bin(&ok, 0, 1, 0, 1, out), PVX_EINVAL);
    T_EQ_I(cap_bin(&ok, 2, 2, 0, 1, out), PVX_EINVAL);
    T_EQ_I(cap_bin(&ok, 2, 1, 0, 5, out), PVX_EINVAL);
    struct cap_image thin = {px, 8, 1, 8, 1, CAP_BAYER_RG8, 0};
    T_EQ_I(cap_bin(&thin, 1, 3, 0, 8, out), PVX_EINVAL);
}

static void names(void)
{
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        T_EQ_I(cap_pixfmt_parse(cap_pixfmt_name(f)), f);
    T_EQ_I(cap_pixfmt_parse("RGB9"), CAP_FMT_NONE);
    T_EQ_S(cap_pixfmt_name(CAP_BAYER_GB8), "BayerGB8");
    T_EQ_I(cap_pixfmt_channels(CAP_BAYER_BG8), 3);
    T_EQ_I(cap_pixfmt_row(CAP_RGB16, 1), 6);
    T_EQ_I(cap_pixfmt_row(CAP_BAYER_GR10P, 5), 7); /* 50 bits */
    T_EQ_I(cap_pixfmt_row(CAP_GREY10PACKED, 5), 9);
    T_EQ_I(cap_pixfmt_row(CAP_BAYER_RG10CSI, 8), 10);
    T_EQ_I(cap_pixfmt_row(CAP_YUYV, 3), 8);
    T_EQ_I(cap_pixfmt_image(CAP_BAYER_BG12, 4, 3), 24);
    T_EQ_I(cap_pixfmt_from_pfnc(0x010c0059u), CAP_BAYER_RG12P);
    T_EQ_I(cap_pixfmt_bayer(CAP_BAYER_GB12CSI)[0], 1);
    T_OK(cap_pixfmt_bayer(CAP_RGB8) == NULL && cap_pixfmt_bayer(CAP_GREY_F32) == NULL);
}

int main(void)
{
    T_RUN(matches_the_reference);
    T_RUN(wide_rows);
    T_RUN(one_saturated_sample_shows);
    T_RUN(not_finite_samples_are_left_out);
    T_RUN(refuses);
    T_RUN(names);
    return t_done();
}
