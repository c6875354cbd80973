/* likeness.h - how far an image is from the one that it should be.  Double sums. */
#ifndef LIKENESS_H
#define LIKENESS_H
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

/* To the bit, but for the bits of a NaN; the first that is not is printed. */
static inline bool image_same(const float *got, const float *want, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (memcmp(&got[i], &want[i], 4) != 0 && !(isnan(got[i]) && isnan(want[i]))) {
            printf("  at %zu: %.9g, want %.9g\n", i, (double)got[i], (double)want[i]);
            return false;
        }
    return true;
}

/* Mean |a-b| on a 0..255 scale (1.0 = 255), as the paper's Fig. 5; 0 for n = 0. */
static inline double image_mean_abs_255(const float *a, const float *b, size_t n)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += fabs((double)a[i] - b[i]);
    return n > 0 ? 255 * sum / (double)n : 0;
}

/* 10 log10(peak^2/MSE), dB; 200 when identical, never more. */
static inline double image_psnr(const float *a, const float *b, size_t n, double peak)
{
    double diff = 0;
    for (size_t i = 0; i < n; i++)
        diff += ((double)a[i] - b[i]) * ((double)a[i] - b[i]);
    if (!(diff > 0))
        return 200;
    return fmin(10 * log10(peak * peak * (double)n / diff), 200);
}

/* One window: (2 mu_a mu_b + C1)(2 cov + C2) / ((mu_a^2 + mu_b^2 + C1)(var_a + var_b + C2)). */
static inline double image_ssim_window(const float *a, const float *b, size_t row, size_t stride,
                                       int32_t nx, int32_t ny, double peak)
{
    double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0, n = (double)nx * ny;
    for (int32_t y = 0; y < ny; y++)
        for (int32_t x = 0; x < nx; x++) {
            size_t i = (size_t)y * row + (size_t)x * stride;
            double u = a[i], v = b[i];
            sa += u;
            sb += v;
            saa += u * u;
            sbb += v * v;
            sab += u * v;
        }
    double ma = sa / n, mb = sb / n;
    double va = saa / n - ma * ma, vb = sbb / n - mb * mb, cov = sab / n - ma * mb;
    double c1 = 0.01 * peak * 0.01 * peak, c2 = 0.03 * peak * 0.03 * peak;
    return (2 * ma * mb + c1) * (2 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
}

/* Mean SSIM of one channel plane [h][w], values `stride` floats apart, with 7x7 windows of equal
 * weight, smaller where the image is (Wang et al., IEEE TIP 13(4):600, 2004). */
static inline double image_ssim(const float *a, const float *b, int32_t w, int32_t h, int stride,
                                double peak)
{
    if (w < 1 || h < 1)
        return 1;
    int32_t nx = w < 7 ? w : 7, ny = h < 7 ? h : 7;
    size_t step = (size_t)stride, row = (size_t)w * step;
    double sum = 0;
    for (int32_t y = 0; y + ny <= h; y++)
        for (int32_t x = 0; x + nx <= w; x++) {
            size_t i = (size_t)y * row + (size_t)x * step;
            sum += image_ssim_window(a + i, b + i, row, step, nx, ny, peak);
        }
    return sum / ((double)(w - nx + 1) * (h - ny + 1));
}
#endif
