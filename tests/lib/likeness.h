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

#endif
