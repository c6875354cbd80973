#include "recon/view/metrics.h"

#include <math.h>

double rec_rel_l2(const float *a, const float *b, size_t n)
{
    double diff = 0, norm = 0;
    for (size_t i = 0; i < n; i++) {
        diff += ((double)a[i] - b[i]) * ((double)a[i] - b[i]);
        norm += (double)b[i] * b[i];
    }
    if (norm > 0)
        return fmin(sqrt(diff / norm), 1e9);
    return diff > 0 ? 1e9 : 0;
}
