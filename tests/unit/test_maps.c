/* test_maps.c - equation (1) of capture/pixel/maps.h in doubles: the order of its steps, pixels that say
 * nothing, saturation, every format's channels; what is refused. */
#include "../t.h"

#include <stdbool.h>

#include "capture/pixel/maps.h"

enum { W = 24, H = 16 };

static const double response[] = {0, 0.1, 0.3, 0.6, 1};

struct bed {
    uint16_t raw[W * H * 3];
    float dark[W * H * 3], flat[W * H * 3], out[W * H * 4];
    struct cap_image img;
    struct cap_photometry c;
    struct cap_convert_params p;
    struct cap_maps *maps;
};

static unsigned sample_most(const struct bed *b)
{
    return (1u << cap_pixfmt_depth(b->img.fmt)) - 1;
}

/* A picture of 16-bit words, maps that are even, and no gain. */
static void bed_init(struct bed *b, enum cap_pixfmt f, int binning, int nch)
{
    bool three = cap_pixfmt_channels(f) == 3 && cap_pixfmt_bayer(f) == NULL;
    size_t n = W * H * (three ? 3 : 1);
    *b = (struct bed){.p = {.binning = binning, .nch = nch}};
    b->img = (struct cap_image){b->raw, n * 2, W, H, (ptrdiff_t)(n / H * 2), f, 0};
    for (size_t i = 0; i < n; i++) {
        b->raw[i] = (uint16_t)t_uniform(1, sample_most(b) - 100);
        b->dark[i] = 0.03f;
        b->flat[i] = 1;
    }
    b->c = (struct cap_photometry){
        .width = W, .height = H, .dark = b->dark, .flat = b->flat, .channels = three ? 3 : 1};
    for (int k = 0; k < 3; k++)
        b->c.gain[k] = 1;
}

/* What the steps of the maps may be off by at most, at light 0..1 (maps.h). */
static double steps(double most_factor, double most_dark)
{
    return most_factor * (ldexp(1, -14) + ldexp(most_dark, -11)) + 1e-6;
}

static void run(struct bed *b)
{
    struct pvx_diag d = {""};
    T_EQ_I(cap_maps_new(&b->c, &b->img, &b->p, &b->maps, &d), PVX_OK);
    T_EQ_S(d.text, "");
    b->p.maps = b->maps;
    T_EQ_I(cap_convert(&b->img, &b->p, 0, H / b->p.binning, b->out), PVX_OK);
}

T_CASE(order_of_the_steps)
{
    static const double matrix[] = {0.9, 0.2, -0.1, 0.05, 1.1, 0, 0, -0.2, 1.3};
    struct bed b;
    bed_init(&b, CAP_RGB16, 1, 3);
    for (size_t i = 0; i < W * H * 3; i++) {
        b.dark[i] = (float)t_uniform(0, 0.1);
        b.flat[i] = (float)t_uniform(0.5, 1.2);
    }
    b.c.response = response;
    b.c.n_response = 5;
    b.c.matrix = matrix;
    b.c.gain[0] = 1.5f;
    b.c.gain[1] = 0.7f;
    run(&b);
    for (size_t i = 0; i < W * H; i++) {
        double v[3];
        for (size_t k = 0; k < 3; k++) {
            double light = cap_response(response, 5, b.raw[i * 3 + k] / 65535.0);
            v[k] = (double)b.c.gain[k] * (light - (double)b.dark[i * 3 + k]) /
                   (double)b.flat[i * 3 + k];
        }
        for (size_t r = 0; r < 3; r++)
            T_NEAR((double)b.out[i * 4 + r],
                   matrix[3 * r] * v[0] + matrix[3 * r + 1] * v[1] + matrix[3 * r + 2] * v[2],
                   1.5 * steps(1.5 / 0.5, 0.1)); /* rows of the matrix: at most 1.5 in all */
        T_EQ_I(b.out[i * 4 + 3] == 0, 1);
    }
    cap_maps_free(&b.maps);
}

/* The response: a piece between two of its values is straight. */
T_CASE(response_between_its_values)
{
    T_NEAR(cap_response(response, 5, 0), 0, 0);
    T_NEAR(cap_response(response, 5, 0.375), 0.2, 1e-12);
    T_NEAR(cap_response(response, 5, 1), 1, 0);
}

T_CASE(uneven_sensitivity_under_even_light_is_exact_in_bins)
{
    struct bed b;
    bed_init(&b, CAP_GREY16, 4, 1);
    for (size_t i = 0; i < W * H; i++) {
        b.flat[i] = (float)t_uniform(0.3, 1.2);
        b.raw[i] = (uint16_t)lrint((0.03 + 0.4 * (double)b.flat[i]) * 65535);
    }
    run(&b);
    for (size_t i = 0; i < W * H / 16; i++)
        T_NEAR((double)b.out[i], 0.4, steps(1 / 0.3, 0.03));
    cap_maps_free(&b.maps);
}

T_CASE(a_hot_pixel_is_left_out)
{
    for (int binning = 1; binning <= 2; binning++) {
        struct bed b;
        bed_init(&b, CAP_GREY12, binning, 1);
        for (size_t i = 0; i < W * H; i++)
            b.raw[i] = 1000;
        b.raw[5 * W + 4] = 4095; /* saturated, too */
        b.dark[5 * W + 4] = NAN;
        b.flat[9 * W + 8] = 0.01f;
        run(&b);
        T_EQ_I(cap_maps_masked(b.maps), 2);
        for (int y = 0; y < H / binning; y++)
            for (int x = 0; x < W / binning; x++) {
                float v = b.out[y * (W / binning) + x];
                if (binning == 1 && ((x == 4 && y == 5) || (x == 8 && y == 9)))
                    T_OK(isnan(v));
                else
                    T_NEAR((double)v, 1000 / 4095.0 - 0.03, 1e-4);
            }
        cap_maps_free(&b.maps);
    }
}

/* A mask is a map of its own, and is the same as a dark that says nothing there: bit by bit, bin by bin. */
T_CASE(a_mask_alone_and_beside_maps)
{
    static const enum cap_pixfmt of[] = {CAP_GREY12, CAP_RGB16, CAP_BAYER_RG12};
    uint8_t used[W * H];
    for (size_t i = 0; i < W * H; i++)
        used[i] = i % W < 3 || i / W == 7 ? 0 : 255;
    for (size_t k = 0; k < 3; k++)
        for (int binning = 1; binning <= 4; binning *= 2) {
            struct bed b, other;
            size_t bins = W * H / (size_t)(binning * binning);
            int blank = 0;
            bed_init(&b, of[k], binning, k == 0 ? 1 : 3);
            memset(b.dark, 0, sizeof b.dark);
            other = b;
            other.img.data = other.raw;
            other.c.dark = other.dark;
            other.c.flat = other.flat;
            for (size_t i = 0; i < W * H * (size_t)b.c.channels; i++)
                other.dark[i] = used[i / (size_t)b.c.channels] != 0 ? 0 : NAN;
            b.c.dark = b.c.flat = NULL;
            b.c.mask = used;
            run(&b);
            run(&other);
            T_EQ_I(cap_maps_masked(b.maps), cap_maps_masked(other.maps));
            for (size_t i = 0; i < bins * (k == 0 ? 1 : 4); i++) {
                bool none = isnan(b.out[i]);
                if (i == 0 && binning == 1) /* with all of its neighbours */
                    T_OK(none);
                T_EQ_I(none, isnan(other.out[i]));
                if (!none)
                    T_NEAR((double)b.out[i], (double)other.out[i], 1e-6);
                blank += none;
            }
            T_OK(binning == 4 || blank > 0);
            cap_maps_free(&b.maps);
            cap_maps_free(&other.maps);
        }
}

T_CASE(saturation_is_judged_by_raw_samples)
{
    static const enum cap_pixfmt of[] = {CAP_GREY12, CAP_RGB16, CAP_BAYER_RG12};
    for (size_t k = 0; k < 3; k++)
        for (int binning = 1; binning <= 2; binning++) {
            struct bed b;
            bed_init(&b, of[k], binning, 3);
            unsigned full = sample_most(&b);
            for (size_t i = 0; i < W * H; i++) { /* nearly full and much vignetted: above 1 */
                for (size_t c = 0; c < (size_t)b.c.channels; c++)
                    b.raw[i * (size_t)b.c.channels + c] = (uint16_t)(full - 64);
                b.flat[i * (size_t)b.c.channels] = 0.3f;
            }
            b.raw[(5 * W + 4) * b.c.channels] = (uint16_t)full;
            run(&b);
            float top = cap_maps_saturated(b.maps), most = 0;
            int tops = 0;
            for (size_t i = 0; i < (size_t)(W / binning * (H / binning) * 4); i++) {
                tops += b.out[i] == top;
                most = b.out[i] < top ? fmaxf(most, b.out[i]) : most;
            }
            T_OK(tops > 0 && tops < W * H / 4);
            T_OK(most > 2 && most * 1.5f < top);
            cap_maps_free(&b.maps);
        }
}

T_CASE(rays_have_their_own_pixels_maps)
{
    struct bed b;
    bed_init(&b, CAP_BAYER_GB16, 1, 3);
    b.p.mosaic = CAP_MOSAIC_RAYS;
    b.c.gain[0] = 2;
    for (size_t i = 0; i < W * H; i++)
        b.flat[i] = (float)t_uniform(0.5, 1.2);
    run(&b);
    const uint8_t *cell = cap_pixfmt_bayer(CAP_BAYER_GB16);
    for (size_t y = 0; y < H; y++)
        for (size_t x = 0; x < W; x++) {
            size_t i = y * W + x, c = cell[y % 2 * 2 + x % 2];
            double want = (double)b.c.gain[c] * (b.raw[i] / 65535.0 - 0.03) / (double)b.flat[i];
            T_NEAR((double)b.out[i * 4 + c], want, steps(2 / 0.5, 0.03));
            T_OK(isnan(b.out[i * 4 + (c + 1) % 3]));
        }
    cap_maps_free(&b.maps);
}

T_CASE(floats_have_no_full_scale)
{
    struct bed b;
    float px[W * H];
    bed_init(&b, CAP_GREY16, 2, 1);
    for (size_t i = 0; i < W * H; i++)
        px[i] = 1;
    b.img.fmt = CAP_GREY_F32;
    b.img.data = px;
    b.img.size = sizeof px;
    b.img.stride = W * 4;
    b.c.response = response;
    b.c.n_response = 5;
    run(&b);
    for (size_t i = 0; i < W * H / 4; i++)
        T_NEAR((double)b.out[i], 0.97, 1e-4);
    cap_maps_free(&b.maps);
}

static void refused(struct bed *b, const char *why)
{
    struct pvx_diag d = {""};
    T_EQ_I(cap_maps_new(&b->c, &b->img, &b->p, &b->maps, &d), PVX_EINVAL);
    T_CONTAINS(d.text, why);
    T_OK(b->maps == NULL);
}

T_CASE(what_is_refused)
{
    static const double falls[] = {0, 0.6, 0.5, 1}, eye[] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    struct bed b;
    bed_init(&b, CAP_GREY12, 1, 3);
    b.c.width = W + 1;
    refused(&b, "maps of 25x16 pixels, but the image has 24x16");
    bed_init(&b, CAP_GREY12, 1, 3);
    b.c.channels = 3;
    refused(&b, "maps of 3 channels, but a Mono12 pixel has 1");
    bed_init(&b, CAP_GREY12, 1, 3);
    b.c.matrix = eye;
    refused(&b, "a grey camera does not have");
    bed_init(&b, CAP_RGB16, 1, 1);
    b.c.matrix = eye;
    refused(&b, "which one channel is not");
    bed_init(&b, CAP_BAYER_RG12, 1, 3);
    b.c.matrix = eye;
    b.p.mosaic = CAP_MOSAIC_RAYS;
    refused(&b, "Bayer pixels as rays");
    bed_init(&b, CAP_GREY12, 1, 1);
    b.c.response = falls;
    b.c.n_response = 4;
    refused(&b, "does not rise");
    bed_init(&b, CAP_GREY12, 1, 1); /* maps for another format than the picture's */
    run(&b);
    b.img.fmt = CAP_BAYER_RG12;
    T_EQ_I(cap_convert(&b.img, &b.p, 0, H, b.out), PVX_EUNSUP);
    cap_maps_free(&b.maps);
}
