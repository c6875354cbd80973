/* clipped.c - equations in clipped.h. */
#include "recon/carve/clipped.h"

#include <math.h>
#include <stdio.h>

#include "recon/carve/photo_pass.h"
#include "recon/simd/lanes.h"

#define MOST_AT_LEVEL 0.75 /* of single samples */
#define FAR           4.0  /* s above the level: h^-1 is the identity there to 1e-5 */
#define NEAR          0.398942280401432678 /* h(0), where the table of h^-1 begins */
#define COARSEST      (1.01 / 255)
#define FINEST        (0.99 / 65535)

static double normal_density(double t)
{
    return 0.398942280401432678 * exp(-0.5 * t * t);
}
static double normal_below(double t)
{
    return 0.5 * erfc(-0.707106781186547524 * t);
}
/* (1), (2) */
static double clipped_mean(double t)
{
    return t * normal_below(t) + normal_density(t);
}
static double clipped_sd(double t)
{
    double h = clipped_mean(t);
    return sqrt((t * t + 1) * normal_below(t) + t * normal_density(t) - h * h);
}

/* (3); the ratio rises with t. */
static double clipped_solve(double ratio)
{
    double lo = 2 * REC_CLIPPED_DEEP, hi = REC_CLIPPED_CLEAR + 1;
    for (int i = 0; i < 40; i++) {
        double t = 0.5 * (lo + hi);
        *(clipped_mean(t) < ratio * clipped_sd(t) ? &lo : &hi) = t;
    }
    return lo;
}

/* h is convex, so Newton's method falls to the root from above. */
void rec_clipped_table(float inverse[REC_CLIPPED_KNOTS])
{
    for (int k = 0; k < REC_CLIPPED_KNOTS; k++) {
        double x = NEAR + k * (FAR - NEAR) / (REC_CLIPPED_KNOTS - 1), t = x;
        for (int i = 0; i < 8; i++)
            t -= (clipped_mean(t) - x) / normal_below(t);
        inverse[k] = (float)t;
    }
}

/* h^-1 of x, NEAR to FAR. */
static double clipped_inverse(const float inverse[REC_CLIPPED_KNOTS], double x)
{
    double u = fmax(0, (x - NEAR) / (FAR - NEAR) * (REC_CLIPPED_KNOTS - 1));
    size_t k = (size_t)fmin(u, REC_CLIPPED_KNOTS - 2);
    double part = u - (double)k;
    return (1 - part) * (double)inverse[k] + part * (double)inverse[k + 1];
}

/* Samples of one picture that a bin's channel is the mean of; 0: not known.  Binned Bayer pixels: green is the mean of
 * its own, red and blue have the weights of (3) in photo.h, and count as the number of equal ones with that noise. */
static double samples_of_one(const struct rec_photo_image *im, int c)
{
    double b = im->binning, axis = 4 * b * b / (8 * b - 6);
    if (im->cell != NULL || b < 1)
        return b < 1 ? 0 : 1;
    if (im->bayer == 0)
        return b * b;
    return b < 2 ? 0 : c == 1 ? b * b / 2 : axis * axis;
}
static double samples_of(const struct rec_photo_image *im, int c)
{
    return samples_of_one(im, c) * (im->pictures > 1 ? (double)im->pictures : 1);
}

/* The least value of channel c above the level; INFINITY: none. */
static float least_above(const struct rec_photo_image *im, int c, float level)
{
    size_t cs = im->nch == 3 ? 4 : 1, n = (size_t)im->bw * (size_t)im->bh;
    float least = INFINITY;
    for (size_t i = 0; i < n; i++) {
        bool has = im->weight[i] != 0 &&
                   (im->cell == NULL || rec_mosaic_lane(im->cell, (int32_t)(i % (size_t)im->bw),
                                                        (int32_t)(i / (size_t)im->bw))[c] != 0);
        float b = im->img[i * cs + (size_t)c];
        least = has && b > level && b < least ? b : least;
    }
    return least;
}

/* (6); 0: no step is to be seen. */
static double sigma_of_step(const struct rec_photo_image *im, int c, float level, double samples)
{
    const float *known = im->work->above;
    float least = known != NULL ? known[c] : least_above(im, c, level);
    double step = ((double)least - (double)level) * samples, gain = (double)im->gain[c];
    return step > FINEST * gain && step < COARSEST * gain ? step / sqrt(12 * samples) : 0;
}

void rec_clipped_find(const struct rec_photo_image *im, int c)
{
    struct rec_photo_work *w = im->work;
    struct rec_clipped *out = &w->clipped[c];
    const struct rec_photo_dark *half = &w->half[c];
    const float level = rec_clipped_level(im, c);
    double n = samples_of(im, c), mean = (double)half->mean - (double)level;
    double sd = sqrt((double)half->noise2);
    if (im->pictures > 1 && im->noise != NULL && im->noise[c] > 0)
        sd = (double)im->noise[c] * (double)im->gain[c] / sqrt(im->pictures);
    double at_level = half->low <= level ? (double)half->at_low : 0;
    *out = (struct rec_clipped){.level = (double)level};
    if (!(n > 0) || im->background != NULL || !(half->low >= level))
        return;
    if (!(sd > 0) || (n < 1.5 && at_level > MOST_AT_LEVEL)) {
        if (half->low == level && at_level > MOST_AT_LEVEL)
            w->sigma[c] = fmaxf(w->sigma[c], (float)sigma_of_step(im, c, level, n));
        return;
    }
    double t = clipped_solve(mean / (sd * sqrt(n)));
    if (t > REC_CLIPPED_CLEAR || (n < 1.5 && !(at_level > 0.01)))
        return;
    out->sigma = sd * sqrt(n) / clipped_sd(t);
    out->share = normal_below(-t);
    out->pedestal = (REC_CLIPPED_WANTED - t) * out->sigma / (double)im->gain[c];
    if (t < REC_CLIPPED_DEEP)
        return;
    out->is = true;
    out->t = fmax(t, 0);
    out->slope = 1 + (1 / normal_below(out->t) - 1) * sqrt(n) / (1 + sqrt(n));
    out->dark = out->sigma * clipped_mean(out->t);
    out->cut = n < 1.5 ? -(mean - out->sigma * out->t) / at_level : 0;
    w->sigma[c] = (float)(out->sigma / sqrt(n));
}

double rec_clipped_share(double mean, double sd, double *pedestal)
{
    double t = sd > 0 ? clipped_solve(mean / sd) : INFINITY;
    *pedestal = t > REC_CLIPPED_CLEAR ? 0 : (REC_CLIPPED_WANTED - t) * sd / clipped_sd(t);
    return t > REC_CLIPPED_CLEAR ? 0 : normal_below(-t);
}

bool rec_photo_say_cut(double cut, double pedestal, char out[REC_PHOTO_CUT_TEXT])
{
    if (!(cut > 0.05))
        return false;
    snprintf(
        out, REC_PHOTO_CUT_TEXT,
        "black is clipped: %.0f %% of the noise of its dark is cut off at 0; raise the camera's "
        "black level by %.2f %% of full scale (%.0f steps of 8 bits, %.0f of 12), and give that "
        "level as photometry.black",
        100 * cut, 100 * pedestal, ceil(255 * pedestal), ceil(4095 * pedestal));
    return true;
}

/* The value above the level without its bias. */
static double mended(const struct rec_photo_work *w, const struct rec_clipped *k, double b)
{
    if (k->cut < 0)
        return b > 0 ? b : k->cut;
    if (b < k->dark)
        return k->sigma * k->t + k->slope * (b - k->dark);
    return b < FAR * k->sigma ? k->sigma * clipped_inverse(w->inverse, b / k->sigma) : b;
}

float rec_clipped_before(const struct rec_clipped *k, float b)
{
    double above = (double)b - k->level, at_dark = k->sigma * k->t;
    if (!k->is || k->cut < 0)
        return b;
    return (float)(k->level + (above < at_dark ? k->dark + (above - at_dark) / k->slope
                                               : k->sigma * clipped_mean(above / k->sigma)));
}

void rec_clipped_mend(const struct rec_photo_image *im, int32_t y0, int32_t y1)
{
    const struct rec_photo_work *w = im->work;
    const struct rec_clipped *clipped = w->clipped;
    size_t cs = im->nch == 3 ? 4 : 1;
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = 0; x < im->bw; x++) {
            size_t i = (size_t)y * (size_t)im->bw + (size_t)x;
            rec_i4 lanes = {-1, -1, -1, 0};
            if (im->cell != NULL)
                lanes = rec_mosaic_lane(im->cell, x, y);
            for (int c = 0; c < im->nch && im->weight[i] != 0; c++)
                if (clipped[c].is && lanes[c] != 0) {
                    float *b = &im->img[i * cs + (size_t)c];
                    *b = (float)(clipped[c].level +
                                 mended(w, &clipped[c], (double)*b - clipped[c].level));
                }
        }
}
