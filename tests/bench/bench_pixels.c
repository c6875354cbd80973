/* bench_pixels.c - raw pixels to float: MB/s of raw bytes for every layout at binning 1 to 5, beside what
 * copying would take: memcpy of as many bytes as are read and written, in the same run, one thread.  And
 * the decoding of JPEG pictures.  PYROVOX_CPU=ref shows what a processor without AVX2 makes of it. */
#include <turbojpeg.h>

#include "base.h"
#include "capture/pixel/jpeg.h"
#include "capture/pixel/maps.h"
#include "capture/pixel/pixfmt.h"

enum { W = 640, H = 480, ROUNDS = 30 };

static FILE *csv;

/* ---- conversion ---- */

/* Best rate of copying `bytes` in and out in all, bytes/s. */
static double copy_rate(size_t bytes)
{
    uint8_t *a = pvx_calloc(bytes / 2 + 1, 1), *b = pvx_calloc(bytes / 2 + 1, 1);
    double best = INFINITY;
    for (int r = 0; r < ROUNDS; r++) {
        int64_t t0 = pvx_now_mono();
        memcpy(b, a, bytes / 2);
        best = fmin(best, (double)(pvx_now_mono() - t0));
        a[r % (int)(bytes / 2)]++;
        if (b[r % (int)(bytes / 2)] == 1 && r < 0)
            puts("");
    }
    free(a);
    free(b);
    return (double)bytes / best * 1e9;
}

enum { RESPONSE = 1, MATRIX = 2, MASK = 4 };
struct way {
    enum cap_pixfmt fmt;
    const char *note;
    enum cap_transfer transfer;
    enum cap_mosaic mosaic;
    int nch;
    int too; /* RESPONSE, MATRIX, MASK of a quarter of the picture */
};

/* Dark, flat and gain of a camera: a pedestal and vignetting, one pixel in 20000 is hot. */
static struct cap_maps *maps_of(const struct cap_image *img, const struct cap_convert_params *p,
                                const struct way *w)
{
    static const double curve[] = {0, 0.2, 0.45, 1};
    static const double colours[] = {1.1, -0.1, 0, 0.05, 0.9, 0.05, 0, -0.1, 1.1};
    int channels = cap_pixfmt_bayer(img->fmt) == NULL ? cap_pixfmt_channels(img->fmt) : 1;
    size_t n = (size_t)img->width * (size_t)img->height * (size_t)channels;
    float *dark = must_floats(n), *flat = must_floats(n);
    uint8_t *used = pvx_calloc(n, 1);
    for (size_t i = 0; i < n; i++) {
        size_t at = i / (size_t)channels, wide = (size_t)img->width;
        double x = (double)(at % wide) / (double)wide - 0.5;
        double y = (double)(at / wide) / (double)wide - 0.375;
        dark[i] = at % 20000 == 9999 ? NAN : (float)(0.02 + 0.002 * bench_even());
        flat[i] = (float)(1 - 0.8 * (x * x + y * y));
        used[at] = x > -0.25;
    }
    struct cap_photometry c = {.width = img->width,
                               .height = img->height,
                               .dark = dark,
                               .flat = flat,
                               .channels = channels,
                               .mask = w->too & MASK ? used : NULL,
                               .response = w->too & RESPONSE ? curve : NULL,
                               .n_response = 4,
                               .matrix = w->too & MATRIX ? colours : NULL,
                               .gain = {1, 1, 1}};
    struct cap_maps *m;
    CHECK(cap_maps_new(&c, img, p, &m, NULL));
    free(dark);
    free(flat);
    free(used);
    return m;
}

/* Least times without maps and with them, in turns. */
static void convert_ns(const struct cap_image *img, const struct way *w, int binning, float *out,
                       double ns[2])
{
    struct cap_convert_params p = {
        .binning = binning, .nch = w->nch, .transfer = w->transfer, .mosaic = w->mosaic};
    struct cap_maps *maps = maps_of(img, &p, w);
    ns[0] = ns[1] = INFINITY;
    for (int r = 0; r < 2 * ROUNDS; r++) {
        p.maps = r % 2 ? maps : NULL;
        int64_t t0 = pvx_now_mono();
        CHECK(cap_convert(img, &p, 0, img->height / binning, out));
        ns[r % 2] = fmin(ns[r % 2], (double)(pvx_now_mono() - t0));
    }
    cap_maps_free(&maps);
}

static void measure(const struct way *w)
{
    size_t n = cap_pixfmt_image(w->fmt, W, H);
    uint8_t *raw = pvx_calloc(n, 1);
    float *out = must_floats((size_t)W * H * 4);
    unsigned mask = cap_pixfmt_layout(w->fmt) == CAP_LAYOUT_16
                        ? (1u << (cap_pixfmt_depth(w->fmt) - 8)) - 1
                        : 255;
    for (size_t i = 0; i < n; i++)
        raw[i] = (uint8_t)(pvx_random(bench_state()) & (i % 2 ? mask : 255));
    if (cap_pixfmt_layout(w->fmt) == CAP_LAYOUT_F32)
        for (size_t i = 0; i < n / 4; i++)
            ((float *)raw)[i] = (float)bench_even();
    struct cap_image img = {raw, n, W, H, (ptrdiff_t)cap_pixfmt_row(w->fmt, W), w->fmt, 0};
    char name[48];
    snprintf(name, sizeof name, "%s%s", cap_pixfmt_name(w->fmt), w->note);
    for (int b = 1; b <= 5; b++) {
        img.width = W / b * b; /* 639 in threes */
        img.height = H / b * b;
        double both[2];
        convert_ns(&img, w, b, out, both);
        double ns = both[0];
        size_t moved = n + (size_t)(W / b) * (size_t)(H / b) * (w->nch == 3 ? 16 : 4);
        double rate = (double)n / ns * 1e3, over = ns * 1e-9 * copy_rate(moved) / (double)moved;
        bench_row(csv, "%s,%d,%.0f,%.2f,%.2f", name, b, rate, over, both[1] / ns);
    }
    free(raw);
    free(out);
}

static void all_formats(void)
{
    static const struct way ways[] = {
        {CAP_GREY8, "", 0, 0, 1, 0},
        {CAP_GREY10, "", 0, 0, 1, 0},
        {CAP_GREY12, "", 0, 0, 1, 0},
        {CAP_GREY14, "", 0, 0, 1, 0},
        {CAP_GREY16, "", 0, 0, 1, 0},
        {CAP_GREY10P, "", 0, 0, 1, 0},
        {CAP_GREY12P, "", 0, 0, 1, 0},
        {CAP_GREY10PACKED, "", 0, 0, 1, 0},
        {CAP_GREY12PACKED, "", 0, 0, 1, 0},
        {CAP_GREY10CSI, "", 0, 0, 1, 0},
        {CAP_GREY12CSI, "", 0, 0, 1, 0},
        {CAP_RGB8, "", 0, 0, 3, 0},
        {CAP_BGR8, "", 0, 0, 3, 0},
        {CAP_RGB16, "", 0, 0, 3, 0},
        {CAP_YUYV, "", 0, 0, 3, 0},
        {CAP_UYVY, "", 0, 0, 3, 0},
        {CAP_YUYV, " linear", CAP_TRANSFER_LINEAR, 0, 3, 0},
        {CAP_RGB8, " sRGB (JPEG)", CAP_TRANSFER_SRGB, 0, 3, 0},
        {CAP_BAYER_RG8, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG8, " bilinear", 0, 0, 3, 0},
        {CAP_BAYER_RG12, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG12, " bilinear", 0, 0, 3, 0},
        {CAP_BAYER_RG16, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG10P, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG10P, " bilinear", 0, 0, 3, 0},
        {CAP_BAYER_RG12P, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG12P, " bilinear", 0, 0, 3, 0},
        {CAP_BAYER_RG10PACKED, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG12PACKED, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG10CSI, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_BAYER_RG12CSI, " rays", 0, CAP_MOSAIC_RAYS, 3, 0},
        {CAP_GREY_F32, "", 0, 0, 1, 0},
        {CAP_RGB_F32, "", 0, 0, 3, 0},
        {CAP_RGB8, " masked too", 0, 0, 3, MASK},
        {CAP_BAYER_RG8, " rays, masked too", 0, CAP_MOSAIC_RAYS, 3, MASK},
        {CAP_RGB8, " matrix too", 0, 0, 3, MATRIX},
        {CAP_GREY8, " response too", 0, 0, 1, RESPONSE},
        {CAP_YUYV, " all", 0, 0, 3, RESPONSE | MATRIX},
    };
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++)
        measure(&ways[i]);
}

/* ---- JPEG ---- */

static void jpeg(const char *name, int sampling, int quality)
{
    unsigned char *px = pvx_calloc((size_t)W * H * 3, 1), *coded = NULL;
    unsigned long n = 0;
    for (int y = 0; y < H; y++) /* a bright flame-like spot with some noise */
        for (int x = 0; x < W; x++) {
            double r2 = pow((x - W / 2) / 80.0, 2) + pow((y - H / 2) / 150.0, 2);
            for (int c = 0; c < 3; c++)
                px[(y * W + x) * 3 + c] =
                    (unsigned char)(230 * exp(-r2 * (1 + c)) + 8 * bench_even() + 4);
        }
    tjhandle tj = tjInitCompress();
    if (tjCompress2(tj, px, W, 0, H, TJPF_RGB, &coded, &n, sampling, quality, 0) != 0)
        exit(1);
    tjDestroy(tj);
    cap_jpeg *j;
    struct cap_image in = {coded, n, W, H, 0, CAP_JPEG, 0}, img;
    double best = INFINITY;
    CHECK(cap_jpeg_new(W, H, &j));
    for (int r = 0; r < ROUNDS; r++) {
        int64_t t0 = pvx_now_mono();
        CHECK(cap_jpeg_decode(j, &in, &img, NULL));
        best = fmin(best, (double)(pvx_now_mono() - t0));
    }
    bench_row(csv, "JPEG %s,1,%.0f,,", name, (double)n / best * 1e3);
    cap_jpeg_free(&j);
    tjFree(coded);
    free(px);
}

int main(int argc, char **argv)
{
    printf(
        "\npixel conversion, %dx%d, one thread: MB/s of raw bytes, and time over that of copying "
        "as many bytes as are read and written; and time with dark, flat and hot pixels over that "
        "without\n",
        W, H);
    csv = bench_csv(argc, argv, "pixels",
                    "format,binning,raw_mb_per_s,time_over_copy,time_with_maps_over_without");
    all_formats();
    jpeg("4:2:2 quality 85", TJSAMP_422, 85);
    jpeg("4:2:0 quality 85", TJSAMP_420, 85);
    jpeg("4:4:4 quality 95", TJSAMP_444, 95);
    jpeg("grey quality 85", TJSAMP_GRAY, 85);
    fclose(csv);
    return 0;
}
