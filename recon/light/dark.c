/* dark.c - levels of pixels without light, and unusable pixels. */
#include <stdlib.h>

#include "base/mem.h"
#include "recon/carve/clipped.h"
#include "recon/light/parts.h"

#define FAR   8 /* scaled MADs: beyond are 6e-16 of normal deviates, and few of a sensor's tail */
#define FLOOR 0.004 /* of full scale; a step of 8 bits */

/* Scaled median of |v - middle|. */
static double dark_spread_of(const float *v, size_t n, double middle, double *scratch)
{
    size_t step = n / REC_LIGHT_SCRATCH + 1, m = 0;
    for (size_t i = 0; i < n; i += step)
        if (isfinite(v[i]))
            scratch[m++] = fabs((double)v[i] - middle);
    return 1.4826 * pvx_median(scratch, m);
}

static pvx_err light_in_it(const struct rec_light_picture *p, double level, struct pvx_diag *d)
{
    double region[REC_REGIONS * REC_REGIONS], least = INFINITY, most = -INFINITY;
    if (level > REC_DARK_MOST)
        return pvx_fail(
            d, PVX_EINVAL,
            "it is no dark: half of its pixels are above %.0f %% of full scale; put the "
            "lens cap on",
            100 * level);
    rec_light_regions(p, p->mean, -1, region);
    for (int r = 0; r < REC_REGIONS * REC_REGIONS; r++) {
        least = fmin(least, region[r]);
        most = fmax(most, region[r]);
    }
    if (most - least > REC_DARK_UNEVEN)
        return pvx_fail(d, PVX_EINVAL,
                        "there is light in the darks: from one part of the picture to another they "
                        "differ by %.1f %% of full scale; put the lens cap on",
                        100 * (most - least));
    return PVX_OK;
}

static void dark_mark(const struct rec_light_picture *p, double level, double *scratch, float *out,
                      struct rec_dark *r)
{
    size_t n = rec_light_pixels(p) * (size_t)p->channels;
    double mean_far = fmax(FAR * dark_spread_of(p->mean, n, level, scratch), FLOOR);
    double var = rec_light_median(p->var, n, scratch);
    double var_far = fmax(FAR * dark_spread_of(p->var, n, var, scratch), FLOOR * FLOOR);
    for (size_t i = 0; i < n; i++) {
        bool hot = (double)p->mean[i] > level + mean_far || (double)p->var[i] > var + var_far;
        bool dead = (double)p->mean[i] < level - mean_far;
        out[i] = hot || dead ? NAN : p->mean[i];
        r->hot += hot;
        r->dead += dead && !hot;
    }
    r->level = level;
    r->read = sqrt(var);
    r->cut = rec_clipped_share(level, r->read, &r->pedestal);
}

pvx_err rec_light_dark(const struct rec_light_picture *p, float *out, struct rec_dark *r,
                       struct pvx_diag *d)
{
    *r = (struct rec_dark){0};
    if (p->n < REC_DARK_LEAST)
        return pvx_fail(d, PVX_EINVAL, "%u dark pictures; take %d or more", p->n, REC_DARK_LEAST);
    double *scratch = pvx_calloc(REC_LIGHT_SCRATCH, sizeof *scratch);
    PVX_NEED(scratch);
    size_t n = rec_light_pixels(p) * (size_t)p->channels;
    double level = rec_light_median(p->mean, n, scratch);
    pvx_err e = light_in_it(p, level, d);
    if (e == PVX_OK)
        dark_mark(p, level, scratch, out, r);
    free(scratch);
    return e;
}
