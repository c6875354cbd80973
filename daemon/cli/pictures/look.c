#include "daemon/cli/pictures/look.h"

#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "capture/files/imgio.h"

const struct look look_defaults = {.exposure = 0, .gamma = 2.2, .tone = LOOK_CLIP, .depth = 8};

static double filmic(double v)
{
    return v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14);
}

/* Factor of a pixel, by (2). */
static double reinhard(const double *v, int nch)
{
    double L = nch == 3 ? 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2] : v[0];
    return (1 + L / (LOOK_HEADROOM * LOOK_HEADROOM)) / (1 + L);
}

double look_headroom(const struct look *l)
{
    return l->tone == LOOK_CLIP ? 1 : LOOK_HEADROOM;
}

void look_samples(const struct look *l, const float *pix, size_t n, int nch, void *samples)
{
    double f = l->exposure > 0 ? l->exposure : 1, most = l->depth == 16 ? 65535 : 255;
    for (size_t i = 0; i < n; i++) {
        double v[3] = {0}, k = 1;
        for (int c = 0; c < nch; c++) {
            double x = f * (double)pix[i * (size_t)nch + (size_t)c];
            v[c] = x > 0 ? fmin(x, 1e9) : 0; /* NaN too */
        }
        if (l->tone == LOOK_REINHARD)
            k = reinhard(v, nch);
        for (int c = 0; c < nch; c++) {
            double x = fmin(l->tone == LOOK_FILMIC ? filmic(v[c]) : k * v[c], 1);
            long s = lrint(most * (l->gamma == 1 ? x : pow(x, 1 / l->gamma)));
            if (l->depth == 16)
                ((uint16_t *)samples)[i * (size_t)nch + (size_t)c] = (uint16_t)s;
            else
                ((uint8_t *)samples)[i * (size_t)nch + (size_t)c] = (uint8_t)s;
        }
    }
}

pvx_err look_save(const struct look *l, const char *path, const float *pix, int32_t w, int32_t h,
                  int nch, struct pvx_diag *d)
{
    size_t n = (size_t)w * (size_t)h;
    void *samples = pvx_calloc(n * (size_t)nch, (size_t)l->depth / 8);
    if (samples == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for the picture", path);
    look_samples(l, pix, n, nch, samples);
    pvx_err e = cap_image_write(path, samples, w, h, nch, l->depth, d);
    free(samples);
    return e;
}
