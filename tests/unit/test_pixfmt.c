/* test_pixfmt.c - every format against its definition: bytes by hand, an independent packer, equations in
 * doubles; binning, saturation, refusals. */
#include "../t.h"

#include <stdbool.h>

#include "capture/pixel/depth.h"
#include "capture/pixel/pixfmt.h"
#include "tests/lib/likeness.h"

enum { W = 48, H = 32, PAD = 7 };

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

static int mirrored(int i, int n)
{
    return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i;
}

/* Part of pixel i's pair of pixels, [i-1, i+1], in the bin's [X b - 1/2, (X+1) b - 1/2]. */
static double covered(int i, int X, int b)
{
    return fmax(0, fmin(i + 1, (X + 1) * b - 0.5) - fmax(i - 1, X * b - 0.5));
}

/* Channel c of bin (X,Y): the mean of its samples.  Red and blue of a Bayer image by area, a bin's neighbours
 * included; with binning 1 the own colour, else that colour's samples among the 8 neighbours.  The image is
 * continued by mirroring. */
static float channel(const struct picture *pic, int b, int X, int Y, int c, bool *saturated)
{
    double sum = 0, weight = 0;
    enum cap_pixfmt f = pic->img.fmt;
    bool bayer = is_bayer(f), own = bayer && b == 1 && colour_of(f, X, Y) == c;
    int per = per_pixel(f), w = pic->img.width, h = pic->img.height;
    double full = full_of(f);
    *saturated = false;
    for (int y = Y * b - 1; y <= (Y + 1) * b; y++)
        for (int x = X * b - 1; x <= (X + 1) * b; x++) {
            bool inside = x >= X * b && x < (X + 1) * b && y >= Y * b && y < (Y + 1) * b;
            double part = inside;
            if (bayer && b == 1)
                part = !own || inside;
            else if (bayer && c != 1)
                part = covered(x, X, b) * covered(y, Y, b);
            if (part == 0 || (bayer && colour_of(f, x, y) != c))
                continue;
            int at = mirrored(y, h) * w + mirrored(x, w);
            double value = pic->sample[at * per + (bayer ? 0 : c)];
            *saturated |= full > 0 && value >= (full == 65535 ? CAP_CLIP_16 : full);
            if (isfinite(value)) {
                sum += part * value;
                weight += part;
            }
        }
    if (*saturated)
        return 1;
    if (weight == 0)
        return NAN;
    return full > 0 ? (float)sum * (1.0f / ((float)weight * (float)full)) : (float)(sum / weight);
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
                v[c] = channel(pic, b, X, Y, c, &sat[c]);
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
    pic->mem = calloc(1, img->size);
    pic->sample = calloc(1, per_row * (size_t)h * sizeof(double));
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

/* What an independent packer put into an image comes out of it, binned by the words of the header;
 * YUV and JPEG have tests of their own. */
T_CASE(what_was_packed_comes_out)
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
                float *want = calloc(1, n * 4), *got = calloc(1, n * 4);
                reference(&pic, b, nch, want);
                int mid = h / b / 2;
                T_EQ_I(cap_bin(&pic.img, b, nch, 0, mid, got), PVX_OK);
                T_EQ_I(cap_bin(&pic.img, b, nch, mid, h / b, got), PVX_OK);
                T_CHECK_(image_same(got, want, n), "%s binning %d, %d channels", cap_pixfmt_name(f),
                         b, nch);
                free(want);
                free(got);
                unmake(&pic);
            }
}

/* Bytes as the definitions of the formats draw them; the values were worked out by hand. */
T_CASE(packed_bytes_by_hand)
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
        {CAP_GREY16, 2, {0x34, 0x12, 0xBF, 0xFF}, {0x1234, 0xFFBF}},
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
T_CASE(garbage_above_the_samples_is_saturation)
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

/* Sensors of 10 to 15 bits in 16, in the upper bits and in the lower: one saturated sample shows in its bin. */
T_CASE(fewer_bits_in_sixteen)
{
    for (int bits = 10; bits <= 15; bits++)
        for (int low = 0; low < 2; low++) {
            char room[120];
            uint16_t px[4 * 4 * 3], top = (uint16_t)((1 << bits) - 1);
            if (!low)
                top = (uint16_t)(top << (16 - bits));
            for (size_t i = 0; i < 48; i++)
                px[i] = top / 4;
            px[7] = px[16] = top; /* in rows 0 and 1: green of the pixels 2 and 1 */
            struct cap_image img = {px, sizeof px, 4, 4, 24, CAP_RGB16, 0};
            struct cap_depth d = {0}, e = {0};
            cap_depth_look(&d, &img, 0, 4, 2);
            cap_depth_look(&e, &img, 1, 4, 2);
            T_EQ_I(d.n * 10 + e.n, 11);
            cap_depth_join(&d, &e);
            T_EQ_I(d.top, top);
            T_EQ_I(d.n, 2);
            T_EQ_I(cap_depth_bits(&d, 2), low ? bits : 0);
            T_EQ_I(cap_depth_bits(&d, 3), 0);
            T_CONTAINS(cap_depth_remedy(CAP_RGB16, bits, "as ", room),
                       bits % 2 == 0 ? "as RGB1" : "multiply the samples by 65535/");
            struct cap_convert_params p = {.binning = 2, .nch = 3, .clip = low ? top : 0};
            float out[16], full = low ? (float)top / 65535 : 1;
            T_EQ_I(cap_convert(&img, &p, 0, 2, out), PVX_OK);
            T_EQ_I(cap_saturated(&img, &p) == full, 1);
            T_OK(out[4 + 1] ==
                 full); /* px[7]: green of the second pixel pair; px[28]: of the third row */
            T_NEAR(out[0], (top / 4) / 65535.0, 1e-6);
            if (bits % 2 == 1 || bits > 14)
                continue;
            /* read as what it is */
            img.fmt = cap_pixfmt_of_depth(CAP_RGB16, bits);
            T_EQ_I(cap_pixfmt_depth(img.fmt) * 10 + cap_pixfmt_channels(img.fmt), bits * 10 + 3);
            T_OK(cap_pixfmt_fits(CAP_RGB16, img.fmt) && !cap_pixfmt_fits(CAP_GREY16, img.fmt));
            T_EQ_I(
                cap_convert(&img, &(struct cap_convert_params){.binning = 2, .nch = 3}, 0, 2, out),
                PVX_OK);
            T_OK(out[4 + 1] == 1);
            if (low)
                T_NEAR(out[0], (top / 4) / (double)top, 1e-6);
        }
    T_EQ_I(cap_pixfmt_of_depth(CAP_BAYER_GB16, 12), CAP_BAYER_GB12);
    T_EQ_I(cap_pixfmt_of_depth(CAP_GREY16, 14), CAP_GREY14);
    T_EQ_I(cap_pixfmt_of_depth(CAP_GREY8, 12), CAP_FMT_NONE);
    T_EQ_I(cap_pixfmt_from_pfnc(0x0230001a), CAP_RGB12);
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

T_CASE(yuv_equations)
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
T_CASE(averages_are_of_light)
{
    uint8_t px[4] = {0, 254, 254, 0};
    struct cap_image img = {px, 4, 2, 2, 2, CAP_GREY8, CAP_YUV_CODED};
    float out[1], one[4];
    T_EQ_I(cap_bin(&img, 2, 1, 0, 1, out), PVX_OK);
    T_NEAR(out[0], srgb(254.0 / 255) / 2, 1e-6);
    T_EQ_I(cap_bin(&img, 1, 1, 0, 2, one), PVX_OK);
    T_NEAR(one[1], srgb(254.0 / 255), 1e-6);
    struct cap_convert_params p = {.binning = 2, .nch = 1, .transfer = CAP_TRANSFER_LINEAR};
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

T_CASE(rays_have_one_channel)
{
    uint8_t px[4] = {10, 20, 255, 40};
    struct cap_image img = {px, 4, 2, 2, 2, CAP_BAYER_GR8, 0};
    struct cap_convert_params p = {.binning = 1, .nch = 3, .mosaic = CAP_MOSAIC_RAYS};
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

T_CASE(one_saturated_sample_shows)
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

T_CASE(not_finite_samples_are_left_out)
{
    float px[4] = {NAN, 0.25f, INFINITY, 2.75f}, out[1];
    struct cap_image img = {px, sizeof px, 2, 2, 8, CAP_GREY_F32, 0};
    T_EQ_I(cap_bin(&img, 2, 1, 0, 1, out), PVX_OK);
    T_OK(out[0] == 1.5f); /* floats do not saturate */
    px[1] = px[3] = -INFINITY;
    T_EQ_I(cap_bin(&img, 2, 1, 0, 1, out), PVX_OK);
    T_OK(isnan(out[0]));
}

T_CASE(refuses)
{
    uint8_t px[64] = {0};
    float out[64];
    const struct {
        struct cap_image img;
        int binning, nch, y0, y1;
        pvx_err e;
    } call[] = {
        {{px, 64, 8, 8, 8, CAP_GREY8, 0}, 2, 1, 0, 4, PVX_OK},
        {{px, 63, 8, 8, 8, CAP_GREY8, 0}, 2, 1, 0, 4, PVX_EFORMAT},
        {{px, 64, 8, 8, 7, CAP_GREY8, 0}, 2, 1, 0, 4, PVX_EINVAL},
        {{px, 64, 8, 8, -8, CAP_GREY8, 0}, 2, 1, 0, 4, PVX_EINVAL},
        {{px, 64, 8, 8, 8, CAP_FMT_NONE, 0}, 2, 1, 0, 4, PVX_EUNSUP},
        {{px, 64, 8, 8, 8, (enum cap_pixfmt)99, 0}, 2, 1, 0, 4, PVX_EUNSUP},
        {{px, 64, 8, 8, 0, CAP_JPEG, 0}, 2, 1, 0, 4, PVX_EUNSUP},
        {{px, 59, 12, 4, 15, CAP_GREY10P, 0}, 4, 1, 0, 1, PVX_EFORMAT}, /* 15 bytes a row */
        {{px, 64, 8, 8, 8, CAP_GREY8, 0}, 3, 1, 0, 1, PVX_EINVAL},
        {{px, 64, 8, 8, 8, CAP_GREY8, 0}, 0, 1, 0, 1, PVX_EINVAL},
        {{px, 64, 8, 8, 8, CAP_GREY8, 0}, 2, 2, 0, 1, PVX_EINVAL},
        {{px, 64, 8, 8, 8, CAP_GREY8, 0}, 2, 1, 0, 5, PVX_EINVAL},
        {{px, 8, 1, 8, 1, CAP_BAYER_RG8, 0}, 1, 3, 0, 8, PVX_EINVAL},
    };
    for (size_t i = 0; i < sizeof call / sizeof call[0]; i++)
        T_CHECK_(cap_bin(&call[i].img, call[i].binning, call[i].nch, call[i].y0, call[i].y1, out) ==
                     call[i].e,
                 "call %zu", i);
}

T_CASE(names)
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
