/* noise.c - read noise and gain by photon transfer; the equation in light.h, (4). */
#include <stdlib.h>

#include "base/mem.h"
#include "recon/light/parts.h"

enum { PER = REC_REGIONS * REC_REGIONS, ROUNDS = 30 };

#define TUKEY 4.685 /* 95 % efficient without outliers */
#define WRONG \
    0.15 /* of the line: more scatter than this, and than 4 times the expected one, is not a line */

/* Mean and variance of each region at each level. */
struct points {
    size_t n;
    double *mean, *var, *expected; /* expected: scatter of var / var, from the number of samples */
    double *scratch;
};

/* Adds the regions of a picture; returns the share of its samples that did not vary at all. */
static double noise_add(struct points *t, const struct rec_light_picture *p)
{
    double mean[PER] = {0}, var[PER] = {0}, count[PER] = {0}, still = 0, all = 0;
    size_t ch = (size_t)p->channels;
    for (size_t i = 0; i < rec_light_pixels(p) * ch; i++) {
        int r = rec_light_region(p, i / ch);
        if (!isfinite(p->mean[i]) || !isfinite(p->var[i]))
            continue;
        mean[r] += (double)p->mean[i];
        var[r] += (double)p->var[i];
        count[r]++;
        all++;
        still += p->var[i] == 0;
    }
    for (int r = 0; r < PER; r++) {
        if (count[r] < 2)
            continue;
        double m = mean[r] / count[r];
        t->mean[t->n] = m;
        t->var[t->n] = fmax(var[r] / count[r] - m * m * p->flicker, 0);
        t->expected[t->n++] = sqrt(2 / (count[r] * (p->n - 1)));
    }
    return all > 0 ? still / all : 1;
}

static double line_at(const struct rec_noise *l, double mean)
{
    return l->read * l->read + l->gain * mean;
}

/* Median of |misfit| / line; if `expected`, also divided by its expected size. */
static double noise_scatter(const struct points *t, const struct rec_noise *l, bool expected)
{
    for (size_t i = 0; i < t->n; i++)
        t->scratch[i] =
            fabs(t->var[i] / line_at(l, t->mean[i]) - 1) / (expected ? t->expected[i] : 1);
    return pvx_median(t->scratch, t->n);
}

/* One round: fits the line with weights from the line of the last round; in the first round all weights are equal. */
static bool round_of(const struct points *t, bool first, struct rec_noise *l, double least)
{
    double s[5] = {0}, scale = first ? 1 : fmax(1.4826 * noise_scatter(t, l, false), 1e-9);
    for (size_t i = 0; i < t->n; i++) {
        double at = fmax(line_at(l, t->mean[i]), least);
        double z = first ? 0 : (t->var[i] / at - 1) / (TUKEY * scale);
        double w = fabs(z) < 1 ? (1 - z * z) * (1 - z * z) / (first ? 1 : at * at) : 0;
        s[0] += w;
        s[1] += w * t->mean[i];
        s[2] += w * t->mean[i] * t->mean[i];
        s[3] += w * t->var[i];
        s[4] += w * t->mean[i] * t->var[i];
    }
    double det = s[0] * s[2] - s[1] * s[1];
    if (!(det > 0))
        return false;
    l->gain = fmax(0, (s[0] * s[4] - s[1] * s[3]) / det);
    l->read = sqrt(fmax(0, (s[3] - l->gain * s[1]) / s[0]));
    return true;
}

static pvx_err noise_fit(const struct points *t, struct rec_noise *out, struct pvx_diag *d)
{
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < t->n; i++) {
        low = fmin(low, t->mean[i]);
        high = fmax(high, t->mean[i]);
        t->scratch[i] = t->var[i];
    }
    if (!(high > low + 0.05) || !(high > 2 * low))
        return pvx_fail(d, PVX_EINVAL,
                        "light from %.3f to %.3f of full scale is one level: add pictures of other "
                        "levels, dark ones too, to tell read noise from gain",
                        t->n > 0 ? low : 0, t->n > 0 ? high : 0);
    double least = 1e-3 * pvx_median(t->scratch, t->n);
    bool ok = least > 0;
    for (int k = 0; k < ROUNDS && ok; k++)
        ok = round_of(t, k == 0, out, least);
    if (!ok || (noise_scatter(t, out, false) > WRONG && noise_scatter(t, out, true) > 4))
        return pvx_fail(d, PVX_EINVAL,
                        "its variance is no line over the light: the light moved from picture to "
                        "picture, or the samples are not linear (pyrovox calibrate response)");
    return PVX_OK;
}

static pvx_err noise_possible(const struct rec_light_picture *p, size_t k, struct pvx_diag *d)
{
    if (p->n < 2)
        return pvx_fail(d, PVX_EINVAL,
                        "level %zu is one picture, which has no noise to be seen: take 2 or more",
                        k + 1);
    if (p->saturated > 0.001)
        return pvx_fail(d, PVX_EINVAL,
                        "level %zu is saturated in %.1f %% of its samples: leave it out or expose "
                        "less",
                        k + 1, 100 * p->saturated);
    if (p->flicker > REC_NOISE_FLICKER * REC_NOISE_FLICKER)
        return pvx_fail(d, PVX_EINVAL,
                        "the light of level %zu flickers by %.1f %% from picture to picture: use a "
                        "lamp on direct current, or expose for whole periods of the mains",
                        k + 1, 100 * sqrt(p->flicker));
    return PVX_OK;
}

pvx_err rec_light_noise(const struct rec_light_picture *p, size_t m, struct rec_noise *out,
                        struct pvx_diag *d)
{
    double still = 0;
    for (size_t k = 0; k < m; k++)
        PVX_TRY(noise_possible(&p[k], k, d));
    double *room = pvx_calloc(m * PER * 4 + 1, sizeof *room);
    PVX_NEED(room);
    struct points t = {.mean = room,
                       .var = room + m * PER,
                       .expected = room + 2 * m * PER,
                       .scratch = room + 3 * m * PER};
    *out = (struct rec_noise){0};
    for (size_t k = 0; k < m; k++)
        still = fmax(still, noise_add(&t, &p[k]) * (p[k].n > 2));
    pvx_err e = still > 0.5
                    ? pvx_fail(d, PVX_EINVAL,
                               "most of its samples do not vary: the noise is below a step of "
                               "them, take them in a pixel format of more bits")
                    : noise_fit(&t, out, d);
    free(room);
    return e;
}
