/* metrics.h - how far a volume or an image is from the truth.  Double sums, pure functions. */
#ifndef REC_METRICS_H
#define REC_METRICS_H
#include <stddef.h>
#include <stdint.h>

/* ||a - b|| / ||b|| over n floats; 0 when both are zero, +inf never (b = 0, a != 0 gives 1e9). */
double rec_rel_l2(const float *a, const float *b, size_t n);
/* Mean |a-b| on a 0..255 scale (1.0 = 255), as the paper's Fig. 5; 0 for n = 0. */
double rec_mean_abs_255(const float *a, const float *b, size_t n);
/* 10 log10(peak^2/MSE), dB; 200 when identical, never more. */
double rec_psnr(const float *a, const float *b, size_t n, double peak);
/* Mean SSIM of one channel plane [h][w], values `stride` floats apart, with 7x7 windows of equal
 * weight, smaller where the image is (Wang et al., IEEE TIP 13(4):600, 2004). */
double rec_ssim(const float *a, const float *b, int32_t w, int32_t h, int stride, double peak);

#endif
