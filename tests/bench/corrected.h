/* corrected.h - pictures as the default solver corrected them (selfcal.h), for solvers that do not correct any. */
#ifndef BENCH_CORRECTED_H
#define BENCH_CORRECTED_H
#include "shot.h"

/* Weights of the four samples about a place t in [0,1) after the second (Catmull & Rom, 1974). */
static inline void corrected_taps(double t, double w[4])
{
    w[0] = t * (-0.5 + t * (1 - 0.5 * t));
    w[1] = 1 + t * t * (-2.5 + 1.5 * t);
    w[2] = t * (0.5 + t * (2 - 1.5 * t));
    w[3] = t * t * (-0.5 + 0.5 * t);
}

static inline long corrected_inside(long v, long n)
{
    return v < 0 ? 0 : v < n ? v : n - 1;
}

/* (1) of selfcal.h; beyond the border the picture goes on as it is there. */
static inline void corrected_picture(const struct rec_camera *c, size_t cs,
                                     const struct rec_selfcal_camera *o, const float *in,
                                     float *out)
{
    double wx[4], wy[4];
    long x0 = (long)floor((double)o->shift[0]), y0 = (long)floor((double)o->shift[1]);
    corrected_taps((double)o->shift[0] - (double)x0, wx);
    corrected_taps((double)o->shift[1] - (double)y0, wy);
    for (long y = 0; y < c->height; y++)
        for (long x = 0; x < c->width; x++)
            for (size_t l = 0; l < cs; l++) {
                double sum = 0;
                for (long n = 0; n < 4; n++)
                    for (long m = 0; m < 4; m++) {
                        long at = corrected_inside(y + y0 + n - 1, c->height) * c->width +
                                  corrected_inside(x + x0 + m - 1, c->width);
                        sum += wy[n] * wx[m] * (double)in[(size_t)at * cs + l];
                    }
                out[(size_t)(y * c->width + x) * cs + l] = (float)((double)o->gain * sum);
            }
}

static inline void shot_correct(struct shot *out, const struct scene *s, const struct shot *in,
                                const struct rec_selfcal_report *found)
{
    *out = (struct shot){.n_cameras = in->n_cameras};
    for (size_t c = 0; c < in->n_cameras; c++) {
        struct rec_selfcal_camera o = found->camera[c];
        if (!found->gain || !o.known)
            o.gain = 1;
        if (!found->shift || !o.known)
            o.shift[0] = o.shift[1] = 0;
        out->floats[c] = in->floats[c];
        out->px[c] = must_floats(in->floats[c]);
        corrected_picture(&s->rig.cameras[c], s->nch == 3 ? 4 : 1, &o, in->px[c], out->px[c]);
    }
}

#endif
