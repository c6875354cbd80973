#include "recon/light/parts.h"

#include <string.h>

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
