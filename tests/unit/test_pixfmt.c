/* test_pixfmt.c - every format against its definition: bytes by hand, an independent packer, equations in
 * doubles; binning, saturation, refusals. */
#include "../t.h"

#include <stdbool.h>

#include "capture/pixel/pixfmt.h"

enum { W = 48, H = 32, PAD = 7 };

struct sample {
    double value;
    bool saturated, finite;
};

/* An image and the samples that were packed into it. */
struct picture {
    struct cap_image img;
    uint8_t *mem;
    double *sample; /* [h][w][1 or 3] */
};

static int colour_of(enum cap_pixfmt f, int x, int y)
{
    const char *pattern = cap_pixfmt_name(f) + 5; /* "BayerRG8" */
    char c = pattern[x & 1];
    if (y & 1) /* the second row holds the other colours: under R is G, under G the missing one */
        c = pattern[x & 1] == 'G' ? (pattern[0] == 'R' || pattern[1] == 'R' ? 'B' : 'R') : 'G';
    return c == 'R' ? 0 : c == 'G' ? 1 : 2;
}

static bool is_bayer(enum cap_pixfmt f)
{
    return strncmp(cap_pixfmt_name(f), "Bayer", 5) == 0;
}

static bool ends_in(enum cap_pixfmt f, const char *tail)
{
    const char *name = cap_pixfmt_name(f);
    size_t n = strlen(name), m = strlen(tail);
    return n >= m && strcmp(name + n - m, tail) == 0;
}

/* Samples per pixel. */
static int per_pixel(enum cap_pixfmt f)
{
    return strncmp(cap_pixfmt_name(f), "RGB", 3) == 0 || f == CAP_BGR8 ? 3 : 1;
}

/* The number in the name: "BayerRG12csi" 12. */
static int depth_of(enum cap_pixfmt f)
{
    return atoi(strpbrk(cap_pixfmt_name(f), "0123456789"));
}

static double full_of(enum cap_pixfmt f)
{
    return ends_in(f, "32f") ? 0 : (double)((1 << depth_of(f)) - 1);
}

/* Put bit `bit` of a row. */
static void put_bit(uint8_t *row, size_t at, unsigned bit)
{
    row[at / 8] = (uint8_t)((row[at / 8] & ~(1u << at % 8)) | bit << at % 8);
}

/* Sample number i of a row into the row's bytes: where each bit goes, as the formats' definitions
 * draw it. */
static void pack(enum cap_pixfmt f, uint8_t *row, size_t i, double value)
{
    unsigned v = (unsigned)value;
    int depth = depth_of(f);
    if (ends_in(f, "32f")) {
        float real = (float)value;
        memcpy(row + i * 4, &real, 4);
        return;
    }
    for (int k = 0; k < depth; k++) {
        unsigned bit = v >> k & 1;
        size_t at; /* bit number in the row, byte by byte, 0 = a byte's least */
        int low = depth - 8;
        if (f == CAP_BGR8)
            at = (i / 3 * 3 + (2 - i % 3)) * 8 + (size_t)k;
        else if (ends_in(f, "p"))
            at = i * (size_t)depth + (size_t)k;
        else if (ends_in(f, "Packed")) /* GigE Vision: bytes HI0, (LO1 << 4 | LO0), HI1 */
            at = k >= low ? (i / 2 * 3 + i % 2 * 2) * 8 + (size_t)(k - low)
                          : (i / 2 * 3 + 1) * 8 + i % 2 * 4 + (size_t)k;
        else if (ends_in(f, "10csi")) /* HI0 HI1 HI2 HI3 (LO3 LO2 LO1 LO0) */
            at = k >= 2 ? (i / 4 * 5 + i % 4) * 8 + (size_t)(k - 2)
                        : (i / 4 * 5 + 4) * 8 + i % 4 * 2 + (size_t)k;
        else if (ends_in(f, "12csi")) /* HI0 HI1 (LO1 LO0) */
            at = k >= 4 ? (i / 2 * 3 + i % 2) * 8 + (size_t)(k - 4)
                        : (i / 2 * 3 + 2) * 8 + i % 2 * 4 + (size_t)k;
        else
            at = i * (depth > 8 ? 16 : 8) + (size_t)k;
        put_bit(row, at, bit);
    }
    if (depth > 8 && cap_pixfmt_layout(f) == CAP_LAYOUT_16)
        for (int k = depth; k < 16; k++)
            put_bit(row, i * 16 + (size_t)k, 0);
}

/* Sample s of pixel (x,y). */
static struct sample sample_at(const struct picture *pic, int x, int y, int s)
{
    int per = per_pixel(pic->img.fmt);
    double full = full_of(pic->img.fmt);
    struct sample out = {.finite = true};
    out.value = pic->sample[(y * pic->img.width + x) * per + s];
    out.finite = isfinite(out.value);
    out.saturated = full > 0 && out.value == full;
    return out;
}

/* Channel c of bin (X,Y): all its samples, in the order of the header's words. */
static float channel(const struct picture *pic, int b, int X, int Y, int c, bool *saturated)
{
    double sum = 0;
    int n = 0;
    enum cap_pixfmt f = pic->img.fmt;
    *saturated = false;
    for (int y = Y * b; y < (Y + 1) * b; y++)
        for (int x = X * b; x < (X + 1) * b; x++) {
            if (is_bayer(f) && colour_of(f, x, y) != c)
                continue;
            struct sample s = sample_at(pic, x, y, is_bayer(f) ? 0 : c);
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
    double full = full_of(f);
    return full > 0 ? (float)sum * (1.0f / ((float)n * (float)full)) : (float)(sum / n);
}

static int mirrored(int i, int n)
{
    return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i;
}

/* Part of pixel i's pair of pixels, [i-1, i+1], in the bin's [X b - 1/2, (X+1) b - 1/2]. */
static double covered(int i, int X, int b)
{
    return fmax(0, fmin(i + 1, (X + 1) * b - 0.5) - fmax(i - 1, X * b - 0.5));
}

/* Red or blue of a bin: mean of its samples by area. */
static float by_area(const struct picture *pic, int b, int X, int Y, int c, bool *saturated)
{
    double sum = 0, area = 0;
    enum cap_pixfmt f = pic->img.fmt;
    *saturated = false;
    for (int y = Y * b - 1; y <= (Y + 1) * b; y++)
        for (int x = X * b - 1; x <= (X + 1) * b; x++) {
            double part = covered(x, X, b) * covered(y, Y, b);
            if (part == 0 || colour_of(f, x, y) != c)
                continue;
            struct sample s =
                sample_at(pic, mirrored(x, pic->img.width), mirrored(y, pic->img.height), 0);
            *saturated |= s.saturated;
            sum += part * s.value;
            area += part;
        }
    return *saturated ? 1 : (float)(4 * sum) * (1.0f / ((float)(4 * area) * (float)full_of(f)));
}

/* Binning 1 of a Bayer image: own colour, else the mean of that colour's samples among the 8
 * neighbours, the image continued by mirroring. */
static float demosaic(const struct picture *pic, int X, int Y, int c, bool *saturated)
{
    double sum = 0;
    int n = 0;
    const struct cap_image *img = &pic->img;
    *saturated = false;
    bool own = colour_of(img->fmt, X, Y) == c;
    for (int y = Y - 1; y <= Y + 1; y++)
        for (int x = X - 1; x <= X + 1; x++) {
            int mx = mirrored(x, img->width), my = mirrored(y, img->height);
            if (colour_of(img->fmt, mx, my) != c || (own && (x != X || y != Y)))
                continue;
            struct sample s = sample_at(pic, mx, my, 0);
            *saturated |= s.saturated;
            sum += s.value;
            n++;
        }
    return *saturated ? 1 : (float)sum * (1.0f / ((float)n * (float)full_of(img->fmt)));
}

static void reference(const struct picture *pic, int b, int nch, float *out)
{
    const struct cap_image *img = &pic->img;
    int bw = img->width / b, bh = img->height / b;
    bool grey = cap_pixfmt_channels(img->fmt) == 1;
    for (int Y = 0; Y < bh; Y++)
        for (int X = 0; X < bw; X++) {
            float v[3] = {0};
            bool sat[3] = {false};
            for (int c = 0; c < (grey ? 1 : 3); c++)
                v[c] = is_bayer(img->fmt) && b == 1   ? demosaic(pic, X, Y, c, &sat[c])
                       : is_bayer(img->fmt) && c != 1 ? by_area(pic, b, X, Y, c, &sat[c])
                                                      : channel(pic, b, X, Y, c, &sat[c]);
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
static void make(enum cap_pixfmt f, int w, int h, int pad, struct picture *pic)
{
    size_t row = cap_pixfmt_row(f, w), per_row = (size_t)w * (size_t)per_pixel(f);
    struct cap_image *img = &pic->img;
    *img = (struct cap_image){.width = w, .height = h, .fmt = f, .stride = (ptrdiff_t)row + pad};
    img->size = (size_t)img->stride * (size_t)(h - 1) + row;
    pic->mem = malloc(img->size);
    pic->sample = malloc(per_row * (size_t)h * sizeof(double));
    for (size_t i = 0; i < img->size; i++)
        pic->mem[i] = (uint8_t)(t_rand() >> 40);
    double full = full_of(f);
    for (int y = 0; y < h; y++)
        for (size_t i = 0; i < per_row; i++) {
            uint64_t dice = t_rand() >> 57;
            double v = floor(t_uniform(0, full + 1));
            if (full == 0) /* float: some not finite */
                v = dice < 8 ? NAN : dice < 16 ? INFINITY : (double)(float)t_uniform(-0.5, 3);
            else if (dice == 0)
                v = full;
            pic->sample[(size_t)y * per_row + i] = v;
            pack(f, pic->mem + y * img->stride, i, v);
        }
    img->data = pic->mem;
}

static void unmake(struct picture *pic)
{
    free(pic->mem);
    free(pic->sample);
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

/* What an independent packer put into an image comes out of it, binned by the words of the header;
 * YUV and JPEG have tests of their own. */
static void what_was_packed_comes_out(void)
{
    static const int bins[] = {1, 2, 3, 4, 8, 16};
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        for (size_t k = 0; k < sizeof bins / sizeof bins[0]; k++)
            for (int nch = 1; nch <= 3; nch += 2) {
                if (cap_pixfmt_layout(f) == CAP_LAYOUT_YUV || f == CAP_JPEG)
                    continue;
                int b = bins[k], w = b == 3 ? 45 : b == 1 ? W + nch : W, h = b == 3 ? 33 : H;
                struct picture pic;
                make(f, w, h, b == 4 ? 0 : PAD, &pic);
                size_t n = (size_t)(w / b) * (size_t)(h / b) * (nch == 3 ? 4 : 1);
                float *want = malloc(n * 4), *got = malloc(n * 4);
                reference(&pic, b, nch, want);
                int mid = h / b / 2;
                T_EQ_I(cap_bin(&pic.img, b, nch, 0, mid, got), PVX_OK);
                T_EQ_I(cap_bin(&pic.img, b, nch, mid, h / b, got), PVX_OK);
                T_CHECK_(same(got, want, n), "%s binning %d, %d channels", cap_pixfmt_name(f), b,
                         nch);
                free(want);
                free(got);
                unmake(&pic);
            }
}

/* Bytes as the definitions of the formats draw them; the values were worked out by hand. */
static void packed_bytes_by_hand(void)
{
    static const struct {
        enum cap_pixfmt f;
        int n;
        uint8_t bytes[6];
        unsigned value[4];
    } known[] = {
        /* PFNC 10p: bits of 0x001, 0x3FE, 0x155, 0x2AA, least first:
         * 1000000000 0111111111 1010101010 0101010101 */
        {CAP_GREY10P, 4, {0x01, 0xF8, 0x5F, 0x95, 0xAA}, {0x001, 0x3FE, 0x155, 0x2AA}},
        /* PFNC 12p: 0x123, 0xABC -> 23, C1, AB */
        {CAP_GREY12P, 2, {0x23, 0xC1, 0xAB}, {0x123, 0xABC}},
        /* GigE Vision Mono10Packed: 0x2A5 = 10 1010 01|01 -> A9 and low 1; 0x13E -> 4F and low 2 */
        {CAP_GREY10PACKED, 2, {0xA9, 0x21, 0x4F}, {0x2A5, 0x13E}},
        /* GigE Vision Mono12Packed: 0x123, 0xABC -> 12, C3, AB */
        {CAP_GREY12PACKED, 2, {0x12, 0xC3, 0xAB}, {0x123, 0xABC}},
        /* MIPI RAW10 (V4L2 Y10P): high bytes of 0x001 0x3FE 0x155 0x2AA, then 10 01 10 01 */
        {CAP_GREY10CSI, 4, {0x00, 0xFF, 0x55, 0xAA, 0x99}, {0x001, 0x3FE, 0x155, 0x2AA}},
        /* MIPI RAW12 (V4L2 Y12P): 0x123, 0xABC -> 12, AB, C3 */
        {CAP_GREY12CSI, 2, {0x12, 0xAB, 0xC3}, {0x123, 0xABC}},
        {CAP_GREY10, 2, {0x34, 0x02, 0xFE, 0x03}, {0x234, 0x3FE}},
        {CAP_GREY14, 2, {0x34, 0x12, 0xFE, 0x3F}, {0x1234, 0x3FFE}},
        {CAP_GREY16, 2, {0x34, 0x12, 0xFE, 0xFF}, {0x1234, 0xFFFE}},
    };
    for (size_t k = 0; k < sizeof known / sizeof known[0]; k++) {
        enum cap_pixfmt f = known[k].f;
        size_t row = cap_pixfmt_row(f, known[k].n);
        struct cap_image img = {known[k].bytes, row, known[k].n, 1, (ptrdiff_t)row, f, 0};
        float out[4];
        T_EQ_I(cap_bin(&img, 1, 1, 0, 1, out), PVX_OK);
        for (int i = 0; i < known[k].n; i++)
            T_CHECK_(lrint((double)out[i] * full_of(f)) == (long)known[k].value[i],
                     "%s pixel %d: %g, want %u", cap_pixfmt_name(f), i, (double)out[i] * full_of(f),
                     known[k].value[i]);
    }
}

/* A camera that aligns its samples to the left, or leaves garbage above them: nothing above 1, and
 * what cannot be believed does not look like a measurement. */
static void garbage_above_the_samples_is_saturation(void)
{
    uint16_t px[4] = {0x8000 | 5, 1023, 1024, 512};
    struct cap_image img = {px, sizeof px, 2, 2, 4, CAP_GREY10, 0};
    float out[4];
    T_EQ_I(cap_bin(&img, 1, 1, 0, 2, out), PVX_OK);
    T_OK(out[0] == 1.0f && out[1] == 1.0f && out[2] == 1.0f);
    T_NEAR(out[3], 512.0 / 1023, 1e-7);
    T_EQ_I(cap_bin(&img, 2, 1, 0, 1, out), PVX_OK);
    T_OK(out[0] == 1.0f);
    img.fmt = CAP_BAYER_RG10;
    float rgb[4];
    T_EQ_I(cap_bin(&img, 2, 3, 0, 1, rgb), PVX_OK);
    T_OK(rgb[0] == 1.0f && rgb[1] == 1.0f && rgb[3] == 0.0f);
    T_NEAR(rgb[2], 512.0 / 1023, 1e-7);
}

static double clip(double v)
{
    return v < 0 ? 0 : v > 1 ? 1 : v;
}

/* R', G' or B' of the standard's equations, in doubles. */
static double of_yuv(int c, double y, double cb, double cr, int yuv)
{
    double kr = yuv & CAP_YUV_709 ? 0.2126 : 0.299, kb = yuv & CAP_YUV_709 ? 0.0722 : 0.114;
    bool full = yuv & CAP_YUV_FULL;
    y = full ? y / 255 : (y - 16) / 219;
    cb = (cb - 128) / (full ? 255 : 224);
    cr = (cr - 128) / (full ? 255 : 224);
    double r = y + 2 * (1 - kr) * cr, b = y + 2 * (1 - kb) * cb;
    return clip(c == 0 ? r : c == 2 ? b : (y - kr * r - kb * b) / (1 - kr - kb));
}

static double srgb(double v)
{
    return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
}

static double bt709(double v)
{
    return v < 0.081 ? v / 4.5 : pow((v + 0.099) / 1.099, 1 / 0.45);
}

static void yuv_equations(void)
{
    static const enum cap_transfer forced[] = {CAP_TRANSFER_AUTO, CAP_TRANSFER_LINEAR,
                                               CAP_TRANSFER_BT709};
    for (int round = 0; round < 3000; round++) {
        uint8_t px[4];
        for (int i = 0; i < 4; i++)
            px[i] = (uint8_t)(t_rand() >> 40);
        bool uyvy = round & 1;
        int yuv = (int)(t_rand() >> 62);
        enum cap_transfer t = forced[round % 3];
        struct cap_image img = {px, 4, 2, 1, 4, uyvy ? CAP_UYVY : CAP_YUYV, (uint8_t)yuv};
        struct cap_convert_params p = {.binning = 1, .nch = 3, .transfer = t};
        float out[8];
        T_EQ_I(cap_convert(&img, &p, 0, 1, out), PVX_OK);
        for (int i = 0; i < 2; i++)
            for (int c = 0; c < 3; c++) {
                double coded = of_yuv(c, px[uyvy ? 1 + 2 * i : 2 * i], px[uyvy ? 0 : 1],
                                      px[uyvy ? 2 : 3], yuv);
                double want = t == CAP_TRANSFER_LINEAR  ? coded
                              : t == CAP_TRANSFER_BT709 ? bt709(coded)
                                                        : srgb(coded);
                /* half a step of R'G'B' times the steepest slope, which is below 2.4 */
                T_NEAR((double)out[4 * i + c], want, 0.505 / 4095 * 2.4);
            }
        T_OK(out[3] == 0 && out[7] == 0);
    }
    /* white, black and mid grey of limited range; nominal white is full scale */
    uint8_t px[4] = {235, 128, 16, 128};
    float out[2];
    struct cap_image img = {px, 4, 2, 1, 4, CAP_YUYV, 0};
    T_EQ_I(cap_bin(&img, 1, 1, 0, 1, out), PVX_OK);
    T_OK(out[0] == 1.0f && out[1] == 0.0f);
    px[2] = 126;
    T_EQ_I(cap_bin(&img, 1, 1, 0, 1, out), PVX_OK);
    T_NEAR(out[1], 0.21616, 1e-4); /* sRGB of 110/219 = 0.50228 */
    img.yuv = CAP_YUV_TRANSFER_709;
    T_EQ_I(cap_bin(&img, 1, 1, 0, 1, out), PVX_OK);
    T_NEAR(out[1], 0.26179, 1e-4);
}

/* Averages are of light, not of its code: a chequer of black and white is half as bright as white. */
static void averages_are_of_light(void)
{
    uint8_t px[4] = {0, 254, 254, 0};
    struct cap_image img = {px, 4, 2, 2, 2, CAP_GREY8, CAP_YUV_CODED};
    float out[1], one[4];
    T_EQ_I(cap_bin(&img, 2, 1, 0, 1, out), PVX_OK);
    T_NEAR(out[0], srgb(254.0 / 255) / 2, 1e-6);
    T_EQ_I(cap_bin(&img, 1, 1, 0, 2, one), PVX_OK);
    T_NEAR(one[1], srgb(254.0 / 255), 1e-6);
    struct cap_convert_params p = {2, 1, CAP_TRANSFER_LINEAR, 0};
    T_EQ_I(cap_convert(&img, &p, 0, 1, out), PVX_OK); /* the user knows better */
    T_NEAR(out[0], 127.0 / 255, 1e-6);
    img.yuv = 0;
    p.transfer = CAP_TRANSFER_BT709;
    T_EQ_I(cap_convert(&img, &p, 0, 1, out), PVX_OK);
    T_NEAR(out[0], bt709(254.0 / 255) / 2, 1e-6);
    float real[1] = {0.5f};
    img = (struct cap_image){real, 4, 1, 1, 4, CAP_GREY_F32, 0};
    p.binning = 1;
    T_EQ_I(cap_convert(&img, &p, 0, 1, out), PVX_EUNSUP);
}

static void rays_have_one_channel(void)
{
    uint8_t px[4] = {10, 20, 255, 40};
    struct cap_image img = {px, 4, 2, 2, 2, CAP_BAYER_GR8, 0};
    struct cap_convert_params p = {1, 3, CAP_TRANSFER_AUTO, CAP_MOSAIC_RAYS};
    float out[4][4];
    T_EQ_I(cap_convert(&img, &p, 0, 2, out[0]), PVX_OK);
    static const int own[4] = {1, 0, 2, 1};
    for (int i = 0; i < 4; i++) {
        for (int c = 0; c < 3; c++)
            T_OK(c == own[i] ? out[i][c] == (i == 2 ? 1.0f : (float)px[i] * (1.0f / 255))
                             : isnan(out[i][c]));
        T_OK(out[i][3] == 0.0f);
    }
    p.binning = 2; /* all channels are there, and nothing is left out */
    T_EQ_I(cap_convert(&img, &p, 0, 1, out[0]), PVX_OK);
    T_NEAR(out[0][1], 25.0 / 255, 1e-6);
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
    bad = (struct cap_image){px, 64, 8, 8, 0, CAP_JPEG, 0};
    T_EQ_I(cap_bin(&bad, 2, 1, 0, 4, out), PVX_EUNSUP);
    bad = (struct cap_image){px, 59, 12, 4, 15, CAP_GREY10P, 0}; /* 15 bytes a row */
    T_EQ_I(cap_bin(&bad, 4, 1, 0, 1, out), PVX_EFORMAT);
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
    T_EQ_I(cap_pixfmt_parse("YUYV"), CAP_YUYV);
    char list[600], cut[20];
    T_EQ_I(cap_pixfmt_names(list, sizeof list), strlen(list));
    T_CONTAINS(list, "Mono12Packed ");
    T_CONTAINS(list, "BayerRG10csi ");
    T_CONTAINS(list, "of RG)");
    T_EQ_I(cap_pixfmt_names(cut, sizeof cut), 19);
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
    T_RUN(what_was_packed_comes_out);
    T_RUN(packed_bytes_by_hand);
    T_RUN(garbage_above_the_samples_is_saturation);
    T_RUN(yuv_equations);
    T_RUN(averages_are_of_light);
    T_RUN(rays_have_one_channel);
    T_RUN(one_saturated_sample_shows);
    T_RUN(not_finite_samples_are_left_out);
    T_RUN(refuses);
    T_RUN(names);
    return t_done();
}
