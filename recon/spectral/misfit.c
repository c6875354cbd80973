#include "recon/spectral/misfit.h"

#include <math.h>

void rec_misfit_calibration(const double C[9], double L[9])
{
    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++) {
            double sum = C[3 * p + q] + (p == q ? REC_SOOT_OWN * REC_SOOT_OWN : 0);
            for (int r = 0; r < q; r++)
                sum -= L[3 * p + r] * L[3 * q + r];
            L[3 * p + q] = p < q ? 0 : p == q ? sqrt(fmax(sum, 0)) : sum / L[4 * q];
        }
}

void rec_misfit_add(struct rec_misfit_part *part, const struct rec_soot_voxel *x, const double N[9],
                    const struct rec_misfit_modes *m)
{
    const double *a = x->misfit_by_e;
    double s2 = 0, modes2 = 0;
    if (x->state != REC_SOOT_OK && x->state != REC_SOOT_NOT)
        return;
    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++)
            s2 += a[p] * N[3 * p + q] * a[q];
    if (!(s2 > 0) || !isfinite(x->misfit))
        return;
    const double w = 1 / s2;
    for (uint32_t k = 0; k < m->n; k++) {
        const float *d = m->d + k * m->stride;
        double sum = 0;
        for (int q = 0; q < 3; q++)
            sum += a[q] * (double)d[q] / (m->tau != NULL ? (double)m->tau[q] : 1);
        modes2 += sum * sum;
        part->modes[k] += w * sum;
    }
    part->weight += w;
    part->x += w * x->misfit;
    part->s += w * sqrt(s2);
    part->t2 += w * w * fmax(s2 - modes2, 0);
    for (int q = 0; q < 3; q++)
        part->b[q] += w * x->misfit_by_k[q];
}

void rec_misfit_volume(const struct rec_misfit_part *part, uint32_t n, uint32_t n_modes,
                       const double L[9], struct rec_misfit *out)
{
    struct rec_misfit_part all = {.weight = 0};
    double var = 0;
    for (uint32_t i = 0; i < n; i++) {
        all.weight += part[i].weight;
        all.x += part[i].x;
        all.s += part[i].s;
        all.t2 += part[i].t2;
        for (int q = 0; q < 3; q++)
            all.b[q] += part[i].b[q];
        for (uint32_t k = 0; k < n_modes; k++)
            all.modes[k] += part[i].modes[k];
    }
    for (uint32_t k = 0; k < n_modes; k++)
        var += all.modes[k] * all.modes[k];
    var = n_modes > 0 ? var + all.t2 : all.s * all.s;
    for (int k = 0; k < 3; k++) {
        double sum = all.b[0] * L[k] + all.b[1] * L[3 + k] + all.b[2] * L[6 + k];
        var += sum * sum;
    }
    out->weight += all.weight;
    out->x += all.x;
    out->sd += sqrt(var); /* both times the weight */
}

void rec_misfit_mean(const struct rec_misfit *m, double *x, double *sd)
{
    *x = m->weight > 0 ? m->x / m->weight : NAN;
    *sd = m->weight > 0 ? m->sd / m->weight : NAN;
}
