#include "recon/carve/absorb.h"

#include <math.h>

#define THIN 1e-4 /* a smaller absorption counts as none */
#define DIM  0.02 /* the same for unlit bins, where it is noise */

double rec_absorb_emitted(double c, double seen)
{
    double left = 1 - c * seen;
    if (!(fabs(c * seen) > THIN))
        return seen * (1 + 0.5 * c * seen);
    if (left < REC_ABSORB_LEAST)
        return (-log(REC_ABSORB_LEAST) + (REC_ABSORB_LEAST - left) / REC_ABSORB_LEAST) / c;
    return -log(left) / c;
}

double rec_absorb_seen(double c, double emitted)
{
    if (!(fabs(c * emitted) > THIN))
        return emitted * (1 - 0.5 * c * emitted);
    double deepest = -log(REC_ABSORB_LEAST);
    if (c * emitted > deepest)
        return (1 - REC_ABSORB_LEAST + (c * emitted - deepest) * REC_ABSORB_LEAST) / c;
    return -expm1(-c * emitted) / c;
}

static double absorb_mean_of(const float *v, int nch)
{
    return nch == 3 ? ((double)v[0] + (double)v[1] + (double)v[2]) / 3 : (double)v[0];
}

void rec_absorb_apply(const struct rec_absorb_picture *p)
{
    size_t cs = p->nch == 3 ? 4 : 1;
    if (!(p->c > 0))
        return;
    for (size_t i = 0; i < p->n; i++) {
        float *b = p->b + i * cs;
        double seen =
            p->mean != NULL ? absorb_mean_of(p->mean + i * 4, p->nch) : absorb_mean_of(b, p->nch);
        if (!(p->c * seen > (p->lit[i] ? THIN : DIM)) || !isfinite(seen))
            continue;
        double left = fmax(1 - p->c * seen, REC_ABSORB_LEAST);
        double r = seen / rec_absorb_emitted(p->c, seen);
        double w = 1 / (1 / (r * r) + (1 / (left * left) - 1 / (r * r)) / p->nch);
        for (size_t l = 0; l < cs; l++)
            b[l] = (float)((double)b[l] / r);
        p->weight[i] *= (float)w;
        for (size_t l = 0; l < 4 && p->weight4 != NULL; l++)
            p->weight4[i * 4 + l] *= (float)w;
        if (p->least != NULL)
            p->least[i] *= (float)w;
    }
}
