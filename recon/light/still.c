/* still.c - whether consecutive pictures show the same. */
#include "recon/light/parts.h"

void rec_light_still_add(struct rec_light_still *s, const float *v, const int32_t size[2],
                         int channels, int stride)
{
    double sum[REC_REGIONS * REC_REGIONS] = {0}, count[REC_REGIONS * REC_REGIONS] = {0};
    for (int32_t y = 0; y < size[1]; y++)
        for (int32_t x = 0; x < size[0]; x++, v += stride) {
            int r = y * REC_REGIONS / size[1] * REC_REGIONS + x * REC_REGIONS / size[0];
            for (int k = 0; k < channels; k++)
                if (isfinite(v[k])) {
                    sum[r] += (double)v[k];
                    count[r]++;
                }
        }
    s->n++;
    for (int r = 0; r < REC_REGIONS * REC_REGIONS; r++) {
        double mean = count[r] > 0 ? sum[r] / count[r] : 0;
        s->sum[r] += mean;
        s->sum2[r] += mean * mean;
    }
}

int rec_light_moves(const struct rec_light_still *s, double *by)
{
    int worst = -1;
    *by = 0;
    for (int r = 0; r < REC_REGIONS * REC_REGIONS && s->n > 1; r++) {
        double mean = s->sum[r] / s->n;
        double sd = sqrt(fmax(0, (s->sum2[r] - s->n * mean * mean) / (s->n - 1)));
        if (sd > 0.002 + 0.02 * mean && sd > *by) {
            worst = r;
            *by = sd;
        }
    }
    return worst;
}
