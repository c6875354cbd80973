#include "recon/spectral/known.h"

#include <math.h>
#include <string.h>

static pvx_err known_possible(const struct rec_known_source *l, const struct rec_known_doubt *doubt,
                              struct pvx_diag *d)
{
    const struct rec_known *k = l->k;
    size_t n = l->n;
    if (n == 0)
        return pvx_fail(d, PVX_EINVAL, "no light of known temperature");
    if (!(doubt->kelvin_sd >= 0 && doubt->emissivity_sd >= 0 && doubt->emissivity_sd < 0.5 &&
          doubt->curve_sd >= 0 && doubt->curve_sd < 0.5))
        return pvx_fail(d, PVX_EINVAL, "the doubts should be 0 to 0.5 of the value, or kelvin");
    for (size_t i = 0; i < n; i++) {
        if (!(k[i].kelvin >= REC_KNOWN_T_LO && k[i].kelvin <= REC_KNOWN_T_HI))
            return pvx_fail(d, PVX_EINVAL, "%g K is outside %g..%g: the temperature is in kelvin",
                            k[i].kelvin, REC_KNOWN_T_LO, REC_KNOWN_T_HI);
        for (int q = 0; q < 3; q++)
            if (!(isfinite(k[i].value[q]) && isfinite(k[i].sd[q]) && k[i].sd[q] >= 0 &&
                  k[i].value[q] > 5 * k[i].sd[q] && k[i].value[q] > 0))
                return pvx_fail(
                    d, PVX_EINVAL,
                    "the %s channel sees %.3g +- %.2g of the light of %g K: too little; expose "
                    "longer, or take a hotter source",
                    rec_spectral_channel(q), k[i].value[q], k[i].sd[q], k[i].kelvin);
    }
    return PVX_OK;
}

/* The sums of (1) and (2) over the observations. */
struct known_sums {
    double mean[3], square[3], noise[3], slope[3]; /* log K, its square, variance of noise, J */
};

static void known_add(struct known_sums *t, const struct rec_known *k,
                      const struct rec_known_source *of, const struct rec_spectral *s)
{
    double n = (double)of->n;
    for (int q = 0; q < 3; q++) {
        double by, l = rec_planck_channel(s, q, k->kelvin, of->g, of->ctx, &by);
        double y = log(k->value[q]) - log(l);
        t->mean[q] += y / n;
        t->square[q] += y * y / n;
        t->noise[q] += k->sd[q] * k->sd[q] / (k->value[q] * k->value[q]) / n;
        t->slope[q] += -by / l / (k->kelvin * k->kelvin) / n; /* d(1/T) = -dT / T^2 */
    }
}

static void known_covariance(const struct known_sums *t, const double scatter[3], double n,
                             const struct rec_known_doubt *doubt, double C[9])
{
    double T2 = doubt->kelvin_sd * doubt->kelvin_sd,
           g2 = doubt->emissivity_sd * doubt->emissivity_sd;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double own = scatter[i] * scatter[i] / n + t->noise[i] / n;
            own += doubt->curve_sd * doubt->curve_sd;
            C[3 * i + j] = t->slope[i] * t->slope[j] * T2 + g2 + (i == j ? own : 0);
        }
}

pvx_err rec_known_source(const struct rec_known_source *l, const struct rec_known_doubt *doubt,
                         struct rec_spectral *s, double *scatter, struct pvx_diag *d)
{
    struct known_sums t = {.mean = {0}};
    double each[3];
    *scatter = 0;
    const double n = (double)l->n;
    PVX_TRY(known_possible(l, doubt, d));
    for (size_t i = 0; i < l->n; i++)
        known_add(&t, &l->k[i], l, s);
    for (int q = 0; q < 3; q++) {
        double v = fmax(0, t.square[q] - t.mean[q] * t.mean[q]);
        each[q] = n > 1 ? sqrt(v * n / (n - 1)) : 0;
        *scatter = fmax(*scatter, each[q]);
        s->constant[q] = exp(t.mean[q]);
        if (!(isfinite(s->constant[q]) && s->constant[q] > 0))
            return pvx_fail(d, PVX_EINVAL, "the %s channel sees nothing of the source",
                            rec_spectral_channel(q));
    }
    if (*scatter > REC_KNOWN_SCATTER)
        return pvx_fail(d, PVX_EINVAL,
                        "the constants of a channel differ by %.0f %% from picture to picture: the "
                        "response curves, the temperatures, the emissivity or the exposures do not "
                        "belong together",
                        100 * *scatter);
    known_covariance(&t, each, n, doubt, s->covariance);
    for (int q = 0; q < 3; q++)
        if (!(s->covariance[4 * q] <= REC_SPECTRAL_MOST))
            return pvx_fail(d, PVX_EINVAL,
                            "the %s channel's constant would be known to %.0f %% only: a constant "
                            "needs a thermometer better than %g K",
                            rec_spectral_channel(q), 100 * sqrt(s->covariance[4 * q]),
                            doubt->kelvin_sd);
    s->absolute = true;
    return PVX_OK;
}

/* (2) of soot.h, of 1 ppm. */
static double known_kappa(const void *ctx, double metres)
{
    return 1e-6 * rec_soot_kappa(ctx, metres);
}

pvx_err rec_known_soot(const struct rec_known *k, const struct rec_soot_params *p,
                       const struct rec_known_doubt *doubt, struct rec_spectral *s,
                       struct pvx_diag *d)
{
    const struct rec_known_source l = {k, 1, known_kappa, p};
    double scatter;
    PVX_TRY(rec_known_source(&l, doubt, s, &scatter, d));
    s->absolute = false;
    return PVX_OK;
}
