/* test_metrics.c - known distances. */
#include "../t.h"

#include "recon/view/metrics.h"
#include "tests/lib/likeness.h"

T_CASE(rel_l2)
{
    float a[2] = {3, 0}, b[2] = {0, 4}, z[2] = {0, 0};
    T_NEAR(rec_rel_l2(a, b, 2), 5.0 / 4, 1e-12);
    T_NEAR(rec_rel_l2(b, b, 2), 0, 0);
    T_NEAR(rec_rel_l2(z, z, 2), 0, 0);
    T_NEAR(rec_rel_l2(a, z, 2), 1e9, 0);
}

T_CASE(mean_abs_and_psnr)
{
    float a[4] = {0, 1, 0.5f, 0.5f}, b[4] = {0.1f, 0.9f, 0.5f, 0.5f};
    T_NEAR(image_mean_abs_255(a, b, 4), 255 * 0.05, 1e-5);
    T_NEAR(image_mean_abs_255(a, b, 0), 0, 0);
    T_NEAR(image_psnr(a, b, 4, 1), 10 * log10(1 / 0.005), 1e-5);
    T_NEAR(image_psnr(a, b, 4, 10), 20 + 10 * log10(1 / 0.005), 1e-5);
    T_NEAR(image_psnr(a, a, 4, 1), 200, 0);
}

T_CASE(ssim)
{
    enum { W = 20, H = 15 };
    float a[W * H * 3], b[W * H * 3];
    for (int i = 0; i < W * H * 3; i++) {
        a[i] = (float)t_uniform(0, 1);
        b[i] = a[i];
    }
    T_NEAR(image_ssim(a, b, W, H, 3, 1), 1, 1e-9);
    /* only the plane asked for counts */
    b[1] += 0.5f;
    T_NEAR(image_ssim(a, b, W, H, 3, 1), 1, 1e-9);
    T_LE(image_ssim(a + 1, b + 1, W, H, 3, 1), 0.9999);
    /* two constants: the structure term is 1, the luminance term is known */
    for (int i = 0; i < W * H; i++) {
        a[i] = 0.5f;
        b[i] = 0.25f;
    }
    double want = (2 * 0.5 * 0.25 + 1e-4) / (0.25 + 0.0625 + 1e-4);
    T_NEAR(image_ssim(a, b, W, H, 1, 1), want, 1e-6);
    T_NEAR(image_ssim(a, b, 3, 2, 1, 1), want, 1e-6); /* smaller than a window */
    /* opposite structure is negative */
    for (int i = 0; i < W * H; i++) {
        a[i] = (float)(i & 1);
        b[i] = 1 - a[i];
    }
    T_LE(image_ssim(a, b, W, H, 1, 1), -0.9);
}
