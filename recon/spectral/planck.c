#include "recon/spectral/planck.h"

#include <math.h>
#include <stddef.h>

#define PIECE 5e-9 /* m */

double rec_planck(double metres, double kelvin)
{
    double x = REC_PLANCK_C2 / (metres * kelvin);
    double scale = 2 * REC_PLANCK_H_JS * REC_PLANCK_C * REC_PLANCK_C;
    return scale / (metres * metres * metres * metres * metres) / expm1(x);
}

/* -d log B / d(1/T) = c2/l times e^x / (e^x - 1). */
static double planck_steepness(double metres, double kelvin)
{
    double x = REC_PLANCK_C2 / (metres * kelvin);
    return REC_PLANCK_C2 / metres / -expm1(-x);
}

double rec_planck_channel(const struct rec_spectral *s, int q, double kelvin, rec_planck_factor *g,
                          const void *ctx, double *slope)
{
    static const double at[4] = {0.069431844202973712, 0.33000947820757187, 0.66999052179242813,
                                 0.93056815579702629},
                        weight[4] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307,
                                     0.17392742256872693};
    double sum = 0, by = 0;
    int pieces = (int)ceil(s->step * 1e-9 / PIECE);
    double long_ = s->step * 1e-9 / pieces;
    for (int i = 0; i + 1 < s->n; i++)
        for (int p = 0; p < pieces && (s->response[q][i] > 0 || s->response[q][i + 1] > 0); p++)
            for (int k = 0; k < 4; k++) {
                double t = (p + at[k]) / pieces;
                double metres = (s->from + (i + t) * s->step) * 1e-9;
                double v = (1 - t) * s->response[q][i] + t * s->response[q][i + 1];
                v *= weight[k] * long_ * rec_planck(metres, kelvin);
                if (g != NULL)
                    v *= g(ctx, metres);
                sum += v;
                by -= v * planck_steepness(metres, kelvin);
            }
    if (slope != NULL)
        *slope = by;
    return sum;
}
