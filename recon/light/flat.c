/* flat.c - sensitivity of each pixel from pictures of an even source at several places. */
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/light/parts.h"

enum { TERMS = 6, ROUNDS = 3, MOST = 64 };

#define DARK_LEVEL 0.02
#define DARK_SHARE 0.05
#define BEYOND     6.0 /* sigma of (1) */

static void terms(const struct rec_light_picture *p, size_t pixel, double t[TERMS])
{
    size_t w = (size_t)p->width;
    double x = 2.0 * (double)(pixel % w) / p->width - 1,
           y = 2.0 * (double)(pixel / w) / p->height - 1;
    t[0] = 1;
    t[1] = x;
    t[2] = y;
    t[3] = x * x;
    t[4] = x * y;
    t[5] = y * y;
}

static double shading(const double q[TERMS], const double t[TERMS])
{
    double s = 0;
    for (int a = 0; a < TERMS; a++)
        s += q[a] * t[a];
    return s;
}

static pvx_err fit_to_use(const struct rec_light_picture *p, size_t k, struct pvx_diag *d)
{
    double region[REC_REGIONS * REC_REGIONS], most = 0;
    if (p->saturated > 0.001)
        return pvx_fail(d, PVX_EINVAL,
                        "picture %zu is saturated in %.1f %% of its samples: expose less", k + 1,
                        100 * p->saturated);
    rec_light_regions(p, p->mean, -1, region);
    for (int r = 0; r < REC_REGIONS * REC_REGIONS; r++)
        most = fmax(most, region[r]);
    for (int r = 0; r < REC_REGIONS * REC_REGIONS; r++)
        if (!(region[r] >= fmax(DARK_LEVEL, DARK_SHARE * most)))
            return pvx_fail(d, PVX_EINVAL,
                            "picture %zu is dark from %d,%d on (%d x %d pixels): the source must "
                            "fill the picture",
                            k + 1, r % REC_REGIONS * p->width / REC_REGIONS,
                            r / REC_REGIONS * p->height / REC_REGIONS, p->width / REC_REGIONS,
                            p->height / REC_REGIONS);
    return PVX_OK;
}

struct fit {
    const struct rec_light_picture *p;
    size_t m, n;              /* pictures, samples */
    double q[MOST][3][TERMS]; /* log shading per picture and colour */
    double sigma;
    float *log_f;
};

/* log p_k - q_k at a sample; NAN where it is not usable. */
static double bare(const struct fit *f, size_t k, size_t i, const double t[TERMS], int c)
{
    double v = (double)f->p[k].mean[i];
    return v > 0 ? log(v) - shading(f->q[k][c], t) : NAN;
}

/* Sets log F to the mean over the pictures, without outliers if `robust`, and sigma. */
static void update(struct fit *f, bool robust)
{
    double sum2 = 0, count2 = 0;
    int channels = f->p->channels;
    for (size_t i = 0; i < f->n; i++) {
        double t[TERMS], v[MOST], sum = 0, middle = 0;
        size_t n = 0, good = 0;
        size_t pixel = i / (size_t)channels;
        int c = rec_light_colour(f->p, pixel, (int)(i % (size_t)channels));
        terms(f->p, pixel, t);
        for (size_t k = 0; k < f->m; k++) {
            double b = bare(f, k, i, t, c);
            if (isfinite(b))
                v[n++] = b;
        }
        if (robust && n > 2)
            middle = pvx_median(v, n);
        for (size_t k = 0; k < n; k++)
            if (!robust || n <= 2 || fabs(v[k] - middle) <= BEYOND * f->sigma) {
                sum += v[k];
                good++;
            }
        f->log_f[i] = good > 0 ? (float)(sum / (double)good) : NAN;
        for (size_t k = 0; k < n && good > 0; k++)
            if (!robust || fabs(v[k] - middle) <= BEYOND * f->sigma) {
                double r = v[k] - (double)f->log_f[i];
                sum2 += r * r;
                count2++;
            }
    }
    f->sigma = count2 > 0 ? sqrt(sum2 / count2) : 0;
}

/* Fits q of picture k and colour c, by least squares. */
static bool refit(struct fit *f, size_t k, int c)
{
    double A[TERMS * TERMS] = {0}, b[TERMS] = {0};
    int channels = f->p->channels;
    for (size_t i = 0; i < f->n; i++) {
        double t[TERMS], v = (double)f->p[k].mean[i];
        size_t pixel = i / (size_t)channels;
        if (rec_light_colour(f->p, pixel, (int)(i % (size_t)channels)) != c || !(v > 0) ||
            !isfinite(f->log_f[i]))
            continue;
        terms(f->p, pixel, t);
        double r = log(v) - (double)f->log_f[i];
        for (int a = 0; a < TERMS; a++) {
            b[a] += t[a] * r;
            for (int e = 0; e <= a; e++)
                A[a * TERMS + e] += t[a] * t[e];
        }
    }
    if (A[0] < TERMS) /* a grey camera has one colour */
        return true;
    if (!rec_spd_solve(A, b, TERMS))
        return false;
    memcpy(f->q[k][c], b, sizeof b);
    return true;
}

/* Makes the sum of q over the pictures 0. */
static void flat_centre(struct fit *f)
{
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < TERMS; a++) {
            double s = 0;
            for (size_t k = 0; k < f->m; k++)
                s += f->q[k][c][a];
            for (size_t k = 0; k < f->m; k++)
                f->q[k][c][a] -= s / (double)f->m;
        }
}

/* F = exp(log F), scaled to mean 1 over the middle quarter per colour. */
static void flat_normalise(const struct fit *f, float *out)
{
    const struct rec_light_picture *p = f->p;
    double sum[3] = {0}, count[3] = {0};
    size_t w = (size_t)p->width, h = (size_t)p->height;
    for (size_t i = 0; i < f->n; i++) {
        size_t pixel = i / (size_t)p->channels, x = pixel % w, y = pixel / w;
        int c = rec_light_colour(p, pixel, (int)(i % (size_t)p->channels));
        out[i] = expf(f->log_f[i]);
        if (isfinite(out[i]) && x >= w / 4 && x < w - w / 4 && y >= h / 4 && y < h - h / 4) {
            sum[c] += (double)out[i];
            count[c]++;
        }
    }
    for (size_t i = 0; i < f->n; i++) {
        int c = rec_light_colour(p, i / (size_t)p->channels, (int)(i % (size_t)p->channels));
        out[i] = (float)((double)out[i] * count[c] / sum[c]);
    }
}

/* Sets pixels unlike their neighbours of the same colour to NaN; returns their number. */
static size_t find_bad(const struct rec_light_picture *p, const float *in, float *out)
{
    int step = p->cell != NULL ? 2 : 1;
    size_t bad = 0, ch = (size_t)p->channels;
    for (int32_t y = 0; y < p->height; y++)
        for (int32_t x = 0; x < p->width; x++)
            for (size_t k = 0; k < ch; k++) {
                double near[24];
                size_t n = 0, at = ((size_t)y * (size_t)p->width + (size_t)x) * ch + k;
                for (int32_t v = y - 2 * step; v <= y + 2 * step; v += step)
                    for (int32_t u = x - 2 * step; u <= x + 2 * step; u += step) {
                        if (u < 0 || v < 0 || u >= p->width || v >= p->height || (u == x && v == y))
                            continue;
                        float g = in[((size_t)v * (size_t)p->width + (size_t)u) * ch + k];
                        if (isfinite(g))
                            near[n++] = (double)g;
                    }
                double middle = pvx_median(near, n), f = (double)in[at];
                bool is_bad = !(f >= 0.4 * middle && f <= 2.5 * middle);
                out[at] = is_bad ? NAN : in[at];
                bad += is_bad;
            }
    return bad;
}

pvx_err rec_light_flat(const struct rec_light_picture *p, size_t m, float *out, struct rec_flat *r,
                       struct pvx_diag *d)
{
    double region[REC_REGIONS * REC_REGIONS];
    *r = (struct rec_flat){.vignetting = INFINITY};
    if (m < 2 || m > MOST)
        return pvx_fail(d, PVX_EINVAL,
                        m < 2 ? "one picture cannot tell the lens from the source: take 2 or more "
                                "with the source at different places, best turned by a quarter each"
                              : "more than 64 pictures: take fewer");
    for (size_t k = 0; k < m; k++)
        PVX_TRY(fit_to_use(&p[k], k, d));
    struct fit *f = pvx_calloc(1, sizeof *f);
    size_t n = rec_light_pixels(p) * (size_t)p->channels;
    float *room = pvx_calloc(n, sizeof *room);
    if (f != NULL && room != NULL) {
        bool good = true;
        *f = (struct fit){.p = p, .m = m, .n = n, .log_f = room};
        for (int round = 0; round < ROUNDS && good; round++) {
            update(f, round > 0);
            for (size_t k = 0; k < m; k++)
                for (int c = 0; c < 3 && good; c++)
                    good = refit(f, k, c);
            flat_centre(f);
        }
        update(f, true);
        flat_normalise(f, out);
        memcpy(room, out, n * sizeof *room);
        r->bad = find_bad(p, room, out);
        r->residual = f->sigma;
        rec_light_regions(p, out, -1, region);
        for (int i = 0; i < REC_REGIONS * REC_REGIONS; i++)
            r->vignetting = fmin(r->vignetting, region[i]);
    }
    pvx_err e = f == NULL || room == NULL ? PVX_ENOMEM : PVX_OK;
    free(room);
    free(f);
    return e;
}
