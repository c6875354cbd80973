#include "recon/light/parts.h"

#include <string.h>

bool rec_light_solve(double *A, double *b, int n)
{
    for (int j = 0; j < n; j++) {
        double *a = A + (size_t)j * (size_t)n, s = a[j];
        for (int k = 0; k < j; k++)
            s -= a[k] * a[k];
        if (!(s > 1e-14 * fabs(a[j]) && s > 0))
            return false;
        a[j] = sqrt(s);
        for (int i = j + 1; i < n; i++) {
            double *c = A + (size_t)i * (size_t)n, t = c[j];
            for (int k = 0; k < j; k++)
                t -= c[k] * a[k];
            c[j] = t / a[j];
        }
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= A[(size_t)i * (size_t)n + (size_t)k] * b[k];
        b[i] /= A[(size_t)i * (size_t)n + (size_t)i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= A[(size_t)k * (size_t)n + (size_t)i] * b[k];
        b[i] /= A[(size_t)i * (size_t)n + (size_t)i];
    }
    return true;
}

void rec_light_regions(const struct rec_light_picture *p, const float *v, int colour,
                       double out[REC_REGIONS * REC_REGIONS])
{
    double count[REC_REGIONS * REC_REGIONS] = {0};
    memset(out, 0, sizeof count);
    for (size_t i = 0; i < rec_light_pixels(p); i++)
        for (int k = 0; k < p->channels; k++) {
            float x = v[i * (size_t)p->channels + (size_t)k];
            if (!isfinite(x) || (colour >= 0 && rec_light_colour(p, i, k) != colour))
                continue;
            out[rec_light_region(p, i)] += (double)x;
            count[rec_light_region(p, i)]++;
        }
    for (int r = 0; r < REC_REGIONS * REC_REGIONS; r++)
        out[r] = count[r] > 0 ? out[r] / count[r] : NAN;
}

double rec_light_median(const float *v, size_t n, double *scratch)
{
    size_t step = n / REC_LIGHT_SCRATCH + 1, m = 0;
    for (size_t i = 0; i < n; i += step)
        if (isfinite(v[i]))
            scratch[m++] = (double)v[i];
    return pvx_median(scratch, m);
}
