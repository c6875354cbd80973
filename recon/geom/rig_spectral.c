#include "recon/geom/rig_spectral.h"

#include <math.h>
#include <stdlib.h>

#include "base/mem.h"

/* ---- reading ---- */

struct reader {
    const pvx_yaml *y;
    int map;
    struct pvx_diag *d;
};

static pvx_err spectral_need(const struct reader *r, const char *key, char full[64], int *node)
{
    *node = pvx_yaml_get(r->y, r->map, key);
    snprintf(full, 64, "spectral.%s", key);
    return *node != 0 ? PVX_OK
                      : pvx_yaml_fail(r->y, r->map, "spectral", PVX_EFORMAT, r->d,
                                      "the key '%s' is missing", key);
}

static pvx_err spectral_number(const struct reader *r, const char *key, double lo, double hi,
                               double *out)
{
    char full[64];
    int node;
    PVX_TRY(spectral_need(r, key, full, &node));
    return pvx_yaml_double(r->y, node, full, lo, hi, out, r->d);
}

static pvx_err spectral_list(const struct reader *r, const char *key, size_t n, double lo,
                             double hi, double *out)
{
    char full[64];
    int node;
    PVX_TRY(spectral_need(r, key, full, &node));
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, n, n, out, r->d));
    for (size_t i = 0; i < n; i++)
        if (!(out[i] >= lo && out[i] <= hi))
            return pvx_yaml_fail(r->y, pvx_yaml_item(r->y, node, i), full, PVX_EINVAL, r->d,
                                 "%g is outside %g..%g", out[i], lo, hi);
    return PVX_OK;
}

static pvx_err spectral_response(const struct reader *r, struct rec_spectral *s)
{
    int red = pvx_yaml_get(r->y, r->map, "red");
    size_t n = pvx_yaml_length(r->y, red);
    PVX_TRY(spectral_number(r, "from", REC_SPECTRAL_LO, REC_SPECTRAL_HI, &s->from));
    PVX_TRY(spectral_number(r, "step", 0.1, 50, &s->step));
    if (red != 0 && (pvx_yaml_kind(r->y, red) != PVX_YAML_SEQ || n < 2 || n > REC_SPECTRAL_MAX))
        return pvx_yaml_fail(r->y, red, "spectral.red", PVX_EFORMAT, r->d,
                             "should be a list of 2 to %d numbers", REC_SPECTRAL_MAX);
    s->n = (int)n;
    if (red != 0 && !(s->from + (s->n - 1) * s->step <= REC_SPECTRAL_HI + 1e-6))
        return pvx_yaml_fail(r->y, red, "spectral.red", PVX_EINVAL, r->d,
                             "ends at %g nm, beyond %g", s->from + (s->n - 1) * s->step,
                             REC_SPECTRAL_HI);
    for (int q = 0; q < 3; q++) {
        double sum = 0;
        PVX_TRY(spectral_list(r, rec_spectral_channel(q), n, 0, 1, s->response[q]));
        for (int i = 0; i < s->n; i++)
            sum += s->response[q][i];
        if (!(sum > 1e-6))
            return pvx_yaml_fail(r->y, pvx_yaml_get(r->y, r->map, rec_spectral_channel(q)),
                                 "spectral", PVX_EINVAL, r->d, "the %s channel sees nothing",
                                 rec_spectral_channel(q));
    }
    return PVX_OK;
}

/* Symmetric, and no combination has a negative variance (to rounding). */
static bool is_covariance(const double C[9])
{
    double scale = C[0] + C[4] + C[8], tiny = 1e-9 * scale;
    if (!(C[0] >= 0 && C[4] >= 0 && C[8] >= 0))
        return false;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < i; j++)
            if (!(fabs(C[3 * i + j] - C[3 * j + i]) <= tiny &&
                  C[3 * i + j] * C[3 * i + j] <= C[4 * i] * C[4 * j] + tiny * scale))
                return false;
    double det = C[0] * (C[4] * C[8] - C[5] * C[7]) - C[1] * (C[3] * C[8] - C[5] * C[6]) +
                 C[2] * (C[3] * C[7] - C[4] * C[6]);
    return det >= -tiny * scale * scale;
}

static pvx_err spectral_constants(const struct reader *r, struct rec_spectral *s)
{
    char full[64];
    int node, absolute;
    PVX_TRY(spectral_list(r, "constant", 3, 1e-30, 1e30, s->constant));
    PVX_TRY(
        spectral_list(r, "covariance", 9, -REC_SPECTRAL_MOST, REC_SPECTRAL_MOST, s->covariance));
    node = pvx_yaml_get(r->y, r->map, "covariance");
    if (!is_covariance(s->covariance))
        return pvx_yaml_fail(r->y, node, "spectral.covariance", PVX_EINVAL, r->d,
                             "is not the covariance of three numbers: it should be symmetric, row "
                             "by row, and no variance negative");
    PVX_TRY(spectral_need(r, "absolute", full, &node));
    PVX_TRY(pvx_yaml_bool(r->y, node, full, &absolute, r->d));
    s->absolute = absolute != 0;
    s->has_exposure = pvx_yaml_get(r->y, r->map, "exposure") != 0;
    return s->has_exposure ? spectral_number(r, "exposure", 1e-9, 1e6, &s->exposure) : PVX_OK;
}

pvx_err rec_spectral_read(const pvx_yaml *y, int map, struct rec_spectral **out, struct pvx_diag *d)
{
    const struct reader r = {y, map, d};
    *out = NULL;
    PVX_TRY(pvx_yaml_known(y, map, "spectral",
                           "from step red green blue constant covariance absolute exposure", d));
    struct rec_spectral *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    pvx_err e = spectral_response(&r, s);
    PVX_THEN(e, spectral_constants(&r, s));
    if (e == PVX_OK)
        *out = s;
    else
        free(s);
    return e;
}

/* ---- writing ---- */

static void put_list(FILE *f, const char *key, const double *v, int n)
{
    fprintf(f, "  %s: [", key);
    for (int i = 0; i < n; i++)
        fprintf(f, "%s%.17g", i == 0 ? "" : ", ", v[i]);
    fputs("]\n", f);
}

void rec_spectral_write(FILE *f, const struct rec_spectral *s)
{
    if (s == NULL)
        return;
    fprintf(f, "spectral:\n  from: %.17g  # nm\n  step: %.17g\n", s->from, s->step);
    for (int q = 0; q < 3; q++)
        put_list(f, rec_spectral_channel(q), s->response[q], s->n);
    put_list(f, "constant", s->constant, 3);
    put_list(f, "covariance", s->covariance, 9);
    fprintf(f, "  absolute: %s\n", s->absolute ? "true" : "false");
    if (s->has_exposure)
        fprintf(f, "  exposure: %.17g\n", s->exposure);
}
