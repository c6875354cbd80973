/* test_pixels.c - every fast way of cap_convert, in plain C and for AVX2, gives the bits of the reference
 * (pixfmt_ref.c): all formats, binnings, transfer functions, matrices, odd widths, and blocks of exactly the
 * image's size so that a sanitizer sees an over-read. */
#include "../t.h"

#include <stdbool.h>

#include "capture/pixel/maps.h"
#include "capture/pixel/pixfmt_priv.h"
#include "tests/lib/likeness.h"

static uint8_t *make(enum cap_pixfmt f, int w, int h, int pad, struct cap_image *img)
{
    size_t row = cap_pixfmt_row(f, w);
    *img = (struct cap_image){.width = w, .height = h, .fmt = f, .stride = (ptrdiff_t)row + pad};
    img->size = (size_t)img->stride * (size_t)(h - 1) + row;
    uint8_t *data = malloc(img->size);
    for (size_t i = 0; i < img->size; i++)
        data[i] = (uint8_t)(t_rand() >> 40);
    int depth = cap_pixfmt_depth(f);
    for (int y = 0; y < h; y++)
        for (size_t i = 0; i < row; i += 4) {
            uint8_t *p = data + y * img->stride + i;
            uint64_t dice = t_rand();
            if (depth == 32) { /* some not finite */
                float v = dice >> 60 == 0 ? NAN : (float)t_uniform(-0.5, 3);
                memcpy(p, &v, 4);
            } else if (cap_pixfmt_layout(f) == CAP_LAYOUT_16 && dice >> 60 != 0) {
                uint16_t full = (uint16_t)((1u << depth) - 1);
                for (size_t k = 0; k < 4 && i + k < row; k += 2) { /* mostly clean upper bits */
                    uint16_t v = (uint16_t)(dice >> (8 + 16 * k / 2)) & full;
                    memcpy(p + k, &v, 2);
                }
            } else if (dice >> 61 == 0) {
                *p = 255; /* full scale, as far as one byte makes it */
            }
        }
    img->data = data;
    return data;
}

/* Every fast way against the reference. */
static void compare_image(const struct cap_image *img, const struct cap_convert_params *p)
{
    int w = img->width, h = img->height;
    struct cap_pix j;
    int bh = h / p->binning;
    size_t n = (size_t)(w / p->binning) * (size_t)bh * (p->nch == 3 ? 4 : 1);
    /* no alignment is asked for */
    float *want = malloc(n * 4 + 4), *got = malloc(n * 4 + 4);
    T_EQ_I(cap_pix_check(img, p, 0, bh, &j), PVX_OK);
    cap_pix_ref(&j, 0, bh, want + 1);
    for (int k = 0; k < 2; k++) { /* in plain C, and what this processor gets */
        struct cap_pix_kernels ways;
        cap_pix_kernels_init(&ways, k == 0 ? PVX_CPU_REF : PVX_CPU_BEST);
        memset(got, 0xA5, n * 4 + 4);
        cap_pix_run(&ways, &j, 0, bh / 3, got + 1);
        cap_pix_run(&ways, &j, bh / 3, bh, got + 1);
        T_CHECK_(image_same(got + 1, want + 1, n),
                 "%s %dx%d binning %d, %d channels, transfer %d, mosaic %d, %s%s",
                 cap_pixfmt_name(img->fmt), w, h, p->binning, p->nch, p->transfer, p->mosaic,
                 k == 0 ? "plain" : "fast", p->maps != NULL ? ", maps" : "");
    }
    free(want);
    free(got);
}

static void compare(enum cap_pixfmt f, int w, int h, const struct cap_convert_params *p, int pad,
                    uint8_t yuv)
{
    struct cap_image img;
    uint8_t *mem = make(f, w, h, pad, &img);
    img.yuv = yuv;
    compare_image(&img, p);
    free(mem);
}

static bool is_integer(enum cap_pixfmt f)
{
    return cap_pixfmt_layout(f) != CAP_LAYOUT_JPEG && cap_pixfmt_depth(f) != 32;
}

T_CASE(every_format_and_binning)
{
    static const int binnings[] = {1, 2, 3, 4, 5, 6, 7, 8, 32, 33, 64};
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        for (size_t k = 0; k < sizeof binnings / sizeof *binnings && f != CAP_JPEG; k++)
            for (int nch = 1; nch <= 3; nch += 2) {
                int b = binnings[k], across = b > 8 ? 1 : 1 + (int)(t_rand() % 13);
                struct cap_convert_params p = {.binning = b, .nch = nch};
                if (b == 1)
                    across += 2;
                compare(f, across * b, b > 8 ? b : 3 * b, &p, (int)(t_rand() % 3), 0);
            }
}

/* Wider than the pieces that the fast ways work in, and ends in all places of a group. */
T_CASE(wide_rows)
{
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        for (int b = 1; b <= 5 && f != CAP_JPEG; b++)
            for (int extra = 0; extra < 3; extra++) {
                int w = (510 + extra + (int)(t_rand() % 700)) / b * b;
                compare(f, w, 2 * b, &(struct cap_convert_params){.binning = b, .nch = 3}, 0, 0);
            }
}

T_CASE(transfers_and_matrices)
{
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        for (int b = 1; b <= 4 && is_integer(f); b++)
            for (int t = CAP_TRANSFER_LINEAR; t <= CAP_TRANSFER_BT709; t++)
                for (int nch = 1; nch <= 3; nch += 2)
                    compare(f, 12 * b, 2 * b,
                            &(struct cap_convert_params){
                                .binning = b, .nch = nch, .transfer = (enum cap_transfer)t},
                            1, (uint8_t)(t_rand() >> 60));
}

T_CASE(rays)
{
    for (enum cap_pixfmt f = CAP_BAYER_RG8; f <= CAP_BAYER_BG12CSI; f++)
        for (int w = 2; w < 700; w = w * 3 + 1)
            for (int t = 0; t <= CAP_TRANSFER_SRGB; t++)
                for (int nch = 1; nch <= 3; nch += 2)
                    compare(f, w, 5,
                            &(struct cap_convert_params){.binning = 1,
                                                         .nch = nch,
                                                         .transfer = (enum cap_transfer)t,
                                                         .mosaic = CAP_MOSAIC_RAYS},
                            0, 0);
}

/* Words that are saturated below their full scale. */
T_CASE(clipped_below_full_scale)
{
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        for (int b = 1; b <= 4 && is_integer(f); b++)
            for (int nch = 1; nch <= 3; nch += 2)
                for (int t = CAP_TRANSFER_LINEAR; t <= CAP_TRANSFER_SRGB; t++) {
                    struct cap_convert_params p = {.binning = b, .nch = nch, .clip = 900};
                    p.transfer = (enum cap_transfer)t;
                    p.mosaic = b == 1 ? CAP_MOSAIC_RAYS : CAP_MOSAIC_DEMOSAIC;
                    compare(f, 40 * b, 3 * b, &p, 1, 0);
                }
}

/* Maps with pixels that say nothing, a response where there are integers, a matrix where it can be. */
static void compare_mapped(enum cap_pixfmt f, int across, int rows, struct cap_convert_params p)
{
    struct cap_image img;
    struct cap_maps *maps;
    struct pvx_diag d = {""};
    uint8_t *mem = make(f, across * p.binning, rows * p.binning, 1, &img);
    int channels = cap_pixfmt_bayer(f) == NULL ? cap_pixfmt_channels(f) : 1;
    size_t n = (size_t)img.width * (size_t)img.height * (size_t)channels;
    float *dark = malloc(n * sizeof *dark), *flat = malloc(n * sizeof *flat);
    double response[5] = {0, 0.1, 0.1, 0.6, 1}, matrix[9];
    for (size_t i = 0; i < n; i++) {
        dark[i] = t_rand() >> 59 == 0 ? NAN : (float)t_uniform(-0.01, 0.1);
        flat[i] = t_rand() >> 59 == 0 ? 0.01f : (float)t_uniform(0.2, 1.3);
    }
    for (int i = 0; i < 9; i++)
        matrix[i] = t_uniform(-0.3, 1);
    bool colour = p.nch == 3 && cap_pixfmt_channels(f) == 3 &&
                  !(cap_pixfmt_bayer(f) != NULL && p.mosaic == CAP_MOSAIC_RAYS && p.binning == 1);
    struct cap_photometry c = {.width = img.width,
                               .height = img.height,
                               .dark = dark,
                               .flat = flat,
                               .channels = channels,
                               .response = is_integer(f) && t_rand() >> 63 ? response : NULL,
                               .n_response = 5,
                               .matrix = colour && t_rand() >> 63 ? matrix : NULL,
                               .gain = {1.5f, 0.5f, 1}};
    T_CHECK_(cap_maps_new(&c, &img, &p, &maps, &d) == PVX_OK, "%s: %s", cap_pixfmt_name(f), d.text);
    p.maps = maps;
    compare_image(&img, &p);
    cap_maps_free(&maps);
    free(dark);
    free(flat);
    free(mem);
}

T_CASE(maps_of_every_format_and_binning)
{
    static const int binnings[] = {1, 2, 3, 4, 5, 8, 17, 33};
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        for (size_t k = 0; k < sizeof binnings / sizeof *binnings && f != CAP_JPEG; k++)
            for (int nch = 1; nch <= 3; nch += 2) {
                int b = binnings[k], across = b > 8 ? 2 : 2 + (int)(t_rand() % 700) / b;
                struct cap_convert_params p = {.binning = b, .nch = nch};
                compare_mapped(f, across, b > 8 ? 1 : 3, p);
                p.clip = 4095;
                p.mosaic = CAP_MOSAIC_RAYS;
                compare_mapped(f, across, b > 8 ? 1 : 3, p);
            }
}

T_CASE(the_processor_decides)
{
    struct cap_pix_kernels plain, best;
    cap_pix_kernels_init(&plain, PVX_CPU_REF);
    cap_pix_kernels_init(&best, PVX_CPU_BEST);
    T_EQ_I(plain.sums != best.sums, pvx_cpu() >= PVX_CPU_AVX2);
}
