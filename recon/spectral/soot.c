#include "recon/spectral/soot.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

enum { NODES = 65, CLOSER = 40 };
#define PI        3.14159265358979323846
#define U_LO      (1 / REC_SOOT_T_HI)
#define U_HI      (1 / REC_SOOT_T_LO)
#define STEP      ((U_HI - U_LO) / (NODES - 1))
#define BETWEEN_T 1800.0 /* K: where the channels are compared */
#define CLOSE     1e-6   /* of a step: less than 1e-4 K */

const char *const rec_soot_state_name[REC_N_SOOT_STATES] = {"dark", "soot", "not soot", "outside"};
const struct rec_soot_params rec_soot_defaults = {
    .em = REC_SOOT_EM, .a = 1, .reject = REC_SOOT_REJECT, .light = REC_SOOT_LIGHT};

struct rec_soot {
    struct rec_soot_params p;
    bool absolute;
    double C[9];
    double log_g[3][NODES], slope[3][NODES]; /* log (K I) and its derivative by 1/T */
    double node_g[3][NODES];                 /* g over the largest of the three */
};

/* ---- the table ---------------------------------------------------------------------------------- */

/* (2) */
double rec_soot_kappa(const void *ctx, double metres)
{
    const struct rec_soot_params *p = ctx;
    return 6 * PI * p->em / metres * pow(REC_SOOT_L0 / metres, p->a - 1);
}

static pvx_err soot_apart(const struct rec_spectral *s, const struct rec_soot_params *p,
                          struct pvx_diag *d)
{
    double least = INFINITY, most = 0, slope;
    for (int q = 0; q < 3; q++) {
        double i = rec_planck_channel(s, q, BETWEEN_T, rec_soot_kappa, p, &slope);
        if (!(i > 0 && isfinite(slope)))
            return pvx_fail(d, PVX_EINVAL, "the %s channel sees nothing of soot",
                            rec_spectral_channel(q));
        least = fmin(least, -slope / i);
        most = fmax(most, -slope / i);
    }
    return most - least >= REC_SOOT_APART
               ? PVX_OK
               : pvx_fail(d, PVX_EINVAL,
                          "the three channels see nearly the same wavelengths (%.0f to %.0f nm): "
                          "their ratios say no temperature; use the response of a colour camera",
                          1e9 * REC_PLANCK_C2 / most, 1e9 * REC_PLANCK_C2 / least);
}

static pvx_err soot_possible(const struct rec_soot_params *p, struct pvx_diag *d)
{
    if (!(p->em >= 0.01 && p->em <= 1))
        return pvx_fail(d, PVX_EINVAL, "E(m) %g is outside 0.01..1", p->em);
    if (!(p->a >= 0 && p->a <= 3))
        return pvx_fail(d, PVX_EINVAL, "the exponent %g of the wavelength is outside 0..3", p->a);
    if (!(p->reject > 0 && p->light > 0))
        return pvx_fail(d, PVX_EINVAL, "the limits of chi^2 and of light should be above 0");
    return PVX_OK;
}

pvx_err rec_soot_new(const struct rec_spectral *s, const struct rec_soot_params *p, rec_soot **out,
                     struct pvx_diag *d)
{
    *out = NULL;
    PVX_TRY(soot_possible(p, d));
    PVX_TRY(soot_apart(s, p, d));
    rec_soot *m = pvx_calloc(1, sizeof *m);
    PVX_NEED(m);
    m->p = *p;
    m->absolute = s->absolute;
    memcpy(m->C, s->covariance, sizeof m->C);
    for (int k = 0; k < NODES; k++) {
        double most = -INFINITY;
        for (int q = 0; q < 3; q++) {
            double slope,
                i = rec_planck_channel(s, q, 1 / (U_LO + k * STEP), rec_soot_kappa, p, &slope);
            m->log_g[q][k] = log(s->constant[q]) + log(i);
            m->slope[q][k] = slope / i;
            most = fmax(most, m->log_g[q][k]);
        }
        for (int q = 0; q < 3; q++)
            m->node_g[q][k] = exp(m->log_g[q][k] - most);
    }
    *out = m;
    return PVX_OK;
}

void rec_soot_free(rec_soot **m)
{
    PVX_FREE(*m);
}

/* log g at u = 1/T, and its slope. */
static void soot_at(const rec_soot *m, double u, double log_g[3], double slope[3])
{
    double x = (u - U_LO) / STEP;
    int k = x < NODES - 2 ? (int)x : NODES - 2;
    double t = x - k, w = 1 - t;
    for (int q = 0; q < 3; q++) {
        double a = m->log_g[q][k], b = m->log_g[q][k + 1];
        double sa = m->slope[q][k] * STEP, sb = m->slope[q][k + 1] * STEP;
        log_g[q] = w * w * ((1 + 2 * t) * a + t * sa) + t * t * ((1 + 2 * w) * b - w * sb);
        slope[q] = (6 * t * w * (b - a) + w * (1 - 3 * t) * sa + t * (3 * t - 2) * sb) / STEP;
    }
}

void rec_soot_emission(const rec_soot *m, double kelvin, double g[3])
{
    double log_g[3], slope[3];
    soot_at(m, 1 / fmin(fmax(kelvin, REC_SOOT_T_LO), REC_SOOT_T_HI), log_g, slope);
    for (int q = 0; q < 3; q++)
        g[q] = exp(log_g[q]);
}

/* ---- one voxel ---------------------------------------------------------------------------------- */

/* Inverse of a symmetric positive definite matrix; false: it is none. */
static bool inverse3(const double A[9], double out[9])
{
    double c0 = A[4] * A[8] - A[5] * A[7], c1 = A[5] * A[6] - A[3] * A[8],
           c2 = A[3] * A[7] - A[4] * A[6], det = A[0] * c0 + A[1] * c1 + A[2] * c2;
    if (!(A[0] > 0 && A[4] > 0 && A[8] > 0 && A[0] * A[4] - A[1] * A[3] > 0 &&
          det > 1e-12 * A[0] * A[4] * A[8]))
        return false;
    out[0] = c0 / det;
    out[4] = (A[0] * A[8] - A[2] * A[6]) / det;
    out[8] = (A[0] * A[4] - A[1] * A[3]) / det;
    out[1] = out[3] = (A[2] * A[7] - A[1] * A[8]) / det;
    out[2] = out[6] = (A[1] * A[5] - A[2] * A[4]) / det;
    out[5] = out[7] = (A[2] * A[3] - A[0] * A[5]) / det;
    return true;
}

static double form(const double W[9], const double a[3], const double b[3])
{
    double s = 0;
    for (int i = 0; i < 3; i++)
        s += a[i] * (W[3 * i] * b[0] + W[3 * i + 1] * b[1] + W[3 * i + 2] * b[2]);
    return s;
}

/* The emission at hand, over its largest value, and the weight V^-1 of (3). */
struct soot_fit {
    const rec_soot *m;
    double e[3], N[9], W[9], ee; /* ee = e' W e */
};

/* The light as a whole over its noise. */
static double soot_light(const struct soot_fit *f)
{
    double W[9];
    return inverse3(f->N, W) ? sqrt(form(W, f->e, f->e)) : 0;
}

/* V of (3) with the light `seen` in place of f g. */
static bool soot_weigh(struct soot_fit *f, const double seen[3])
{
    static const double own[2] = {0, REC_SOOT_OWN * REC_SOOT_OWN};
    double V[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            V[3 * i + j] = f->N[3 * i + j] + seen[i] * (f->m->C[3 * i + j] + own[i == j]) * seen[j];
    if (!inverse3(V, f->W))
        return false;
    f->ee = form(f->W, f->e, f->e);
    return true;
}

/* (3) with the best f >= 0 for this g. */
static double soot_chi2(const struct soot_fit *f, const double g[3], double *best)
{
    double ge = form(f->W, g, f->e), gg = form(f->W, g, g);
    *best = ge > 0 ? ge / gg : 0;
    return f->ee - *best * ge;
}

/* g over its largest value, which is exp(*top). */
static void soot_shape(const rec_soot *m, double u, double g[3], double slope[3], double *top)
{
    double log_g[3];
    soot_at(m, u, log_g, slope);
    *top = fmax(log_g[0], fmax(log_g[1], log_g[2]));
    for (int q = 0; q < 3; q++)
        g[q] = exp(log_g[q] - *top);
}

/* Half of minus the derivative of (3) by u, with the best f. */
static double soot_downhill(const struct soot_fit *f, double u)
{
    double g[3], slope[3], top, best, left[3], by_u[3];
    soot_shape(f->m, u, g, slope, &top);
    soot_chi2(f, g, &best);
    for (int q = 0; q < 3; q++) {
        left[q] = f->e[q] - best * g[q];
        by_u[q] = best * g[q] * slope[q];
    }
    return form(f->W, left, by_u);
}

/* The node of the least chi^2, the first of such.  chi^2 - e'We = -(g'We)^2 / g'Wg. */
static int soot_node(const struct soot_fit *f)
{
    const double *W = f->W, *const g[3] = {f->m->node_g[0], f->m->node_g[1], f->m->node_g[2]};
    const double w01 = 2 * W[1], w02 = 2 * W[2], w12 = 2 * W[5];
    double We[3], chi2[NODES];
    for (int i = 0; i < 3; i++)
        We[i] = W[3 * i] * f->e[0] + W[3 * i + 1] * f->e[1] + W[3 * i + 2] * f->e[2];
    for (int k = 0; k < NODES; k++) {
        double a = g[0][k], b = g[1][k], c = g[2][k];
        double ge = a * We[0] + b * We[1] + c * We[2];
        double gg = a * (W[0] * a + w01 * b + w02 * c) + b * (W[4] * b + w12 * c) + W[8] * c * c;
        ge = ge > 0 ? ge : 0;
        chi2[k] = -ge * ge / gg;
    }
    int node = 0;
    for (int k = 1; k < NODES; k++)
        if (chi2[k] < chi2[node])
            node = k;
    return node;
}

/* Where soot_downhill is 0 between lo, where it is above 0, and hi, where it is below: false position (Illinois: an end
 * that stays counts half). */
static double soot_between(const struct soot_fit *f, double lo, double at_lo, double hi,
                           double at_hi)
{
    double u = lo, was = hi;
    for (int i = 0, stays = 0; i < CLOSER && fabs(u - was) > CLOSE * STEP; i++) {
        was = u;
        u = (lo * at_hi - hi * at_lo) / (at_hi - at_lo);
        double at = soot_downhill(f, u);
        if (at > 0) {
            lo = u;
            at_lo = at;
            at_hi *= stays < 0 ? 0.5 : 1;
            stays = -1;
        } else if (at < 0) {
            hi = u;
            at_hi = at;
            at_lo *= stays > 0 ? 0.5 : 1;
            stays = 1;
        } else
            break;
    }
    return u;
}

/* u = 1/T of the least chi^2: near the best node, and at an end of the range where it still falls there. */
static double soot_best(const struct soot_fit *f, int *node)
{
    int k = *node = soot_node(f);
    double u = U_LO + STEP * k, at = soot_downhill(f, u);
    if (at == 0 || (at < 0 ? k == 0 : k == NODES - 1))
        return u;
    double other = u + (at > 0 ? STEP : -STEP), at_other = soot_downhill(f, other);
    if ((at > 0) == (at_other > 0))
        return u;
    return at > 0 ? soot_between(f, u, at, other, at_other)
                  : soot_between(f, other, at_other, u, at);
}

/* Bars of log f and 1/T, from the inverse of J' W J, and their derivatives by e. */
struct soot_bars {
    double log_f_sd, u_sd, log_f_by_e[3], u_by_e[3];
};

static bool soot_bars(const struct soot_fit *f, const double seen[3], const double slope[3],
                      struct soot_bars *out)
{
    double ju[3];
    for (int q = 0; q < 3; q++)
        ju[q] = seen[q] * slope[q];
    double ff = form(f->W, seen, seen), fu = form(f->W, seen, ju), uu = form(f->W, ju, ju);
    double det = ff * uu - fu * fu;
    if (!(det > 1e-14 * ff * uu))
        return false;
    out->log_f_sd = sqrt(uu / det);
    out->u_sd = sqrt(ff / det);
    for (int q = 0; q < 3; q++) {
        const double *w = f->W + (ptrdiff_t)3 * q;
        double jf_w = w[0] * seen[0] + w[1] * seen[1] + w[2] * seen[2];
        double ju_w = w[0] * ju[0] + w[1] * ju[1] + w[2] * ju[2];
        out->log_f_by_e[q] = (uu * jf_w - fu * ju_w) / det;
        out->u_by_e[q] = (ff * ju_w - fu * jf_w) / det;
    }
    return true;
}

/* (4) */
static void soot_misfit(const struct soot_fit *f, const double seen[3], const double slope[3],
                        double scale, struct rec_soot_voxel *v)
{
    double h[3];
    v->misfit = 0;
    for (int q = 0; q < 3; q++) {
        int r = (q + 1) % 3, s = (q + 2) % 3;
        h[q] = seen[r] * seen[s] * (slope[s] - slope[r]); /* of seen x (seen slope) */
    }
    for (int q = 0; q < 3; q++) {
        double by = h[q] / (h[1] * seen[1]);
        v->misfit += by * (f->e[q] - seen[q]);
        v->misfit_by_e[q] = by / scale;
        v->misfit_by_k[q] = -by * seen[q];
    }
}

/* Bars and derivatives of the temperature 1/u and the amount f, which is 0 where it is not known. */
static void soot_derivatives(const struct soot_bars *b, const double seen[3], double u, double f,
                             double scale, struct rec_soot_voxel *v)
{
    const double wide = sinh(2 * b->log_f_sd) / (2 * b->log_f_sd); /* the bar of f over f s */
    v->kelvin = 1 / u;
    v->kelvin_sd = b->u_sd / (u * u);
    for (int q = 0; q < 3; q++) {
        v->kelvin_by_e[q] = -b->u_by_e[q] / (u * u) / scale;
        v->kelvin_by_k[q] = -v->kelvin_by_e[q] * seen[q] * scale;
        v->f_by_e[q] = f * wide * b->log_f_by_e[q] / scale;
        v->f_by_k[q] = -v->f_by_e[q] * seen[q] * scale;
    }
    if (f > 0) {
        v->f = f;
        v->f_sd = f * wide * b->log_f_sd;
    }
}

static const struct rec_soot_voxel soot_nothing = {.state = REC_SOOT_DARK,
                                                   .kelvin = NAN,
                                                   .kelvin_sd = NAN,
                                                   .f = NAN,
                                                   .f_sd = NAN,
                                                   .chi2 = NAN,
                                                   .misfit = NAN};

/* e and N over the largest |e|, so that no square is too small or too large. */
static bool soot_scale(struct soot_fit *f, const double e[3], const double N[9], double *scale)
{
    double largest = fmax(e[0], fmax(e[1], e[2]));
    *scale = largest;
    if (!(isfinite(e[0]) && isfinite(e[1]) && isfinite(e[2]) && largest > 0 &&
          isfinite(1 / largest)))
        return false;
    for (int i = 0; i < 3; i++)
        f->e[i] = e[i] / largest;
    for (int i = 0; i < 9; i++)
        if (!isfinite(f->N[i] = N[i] / largest / largest))
            return false;
    return true;
}

struct rec_soot_voxel rec_soot_solve(const rec_soot *m, const double e[3], const double N[9])
{
    struct soot_fit f = {.m = m};
    struct rec_soot_voxel v = soot_nothing;
    struct soot_bars bars;
    double scale, g[3], slope[3], top, amount = 0, u = 0;
    int node = 0;
    if (!soot_scale(&f, e, N, &scale) || !(soot_light(&f) >= m->p.light))
        return v;
    double seen[3] = {fmax(f.e[0], 0), fmax(f.e[1], 0), fmax(f.e[2], 0)};
    for (int pass = 0; pass < 2; pass++) {
        if (!soot_weigh(&f, seen))
            return v;
        u = soot_best(&f, &node);
        soot_shape(m, u, g, slope, &top);
        v.chi2 = fmax(soot_chi2(&f, g, &amount), 0);
        for (int q = 0; q < 3; q++)
            seen[q] = amount * g[q];
    }
    soot_misfit(&f, seen, slope, scale, &v);
    if (v.chi2 > m->p.reject) {
        v.state = REC_SOOT_NOT;
        return v;
    }
    if (node == 0 || node == NODES - 1) {
        v.state = REC_SOOT_OUTSIDE;
        return v;
    }
    if (!soot_bars(&f, seen, slope, &bars) || bars.u_sd / u > REC_SOOT_DOUBT)
        return v;
    v.state = REC_SOOT_OK;
    soot_derivatives(&bars, seen, u, m->absolute ? amount * scale * exp(-top) : 0, scale, &v);
    return v;
}
