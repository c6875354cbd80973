#include "recon/spectral/curves.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define GAP_NM 50

/* ---- text --------------------------------------------------------------------------------------- */

static bool is_apart(char c)
{
    return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r';
}

/* The numbers of a line; -1: something in it is none. */
static int line_numbers(const char *s, const char *end, double out[5])
{
    int n = 0;
    while (s < end) {
        char word[48], *rest;
        size_t len = 0;
        while (s < end && is_apart(*s))
            s++;
        while (s + len < end && !is_apart(s[len]))
            len++;
        if (len == 0)
            break;
        if (len >= sizeof word || n == 5)
            return -1;
        memcpy(word, s, len);
        word[len] = '\0';
        /* strtod alone would take "nan", "0x1p3" and "inf" */
        if (word[strspn(word, "0123456789+-.eE")] != '\0')
            return -1;
        out[n++] = strtod(word, &rest);
        if (*rest != '\0' || !isfinite(out[n - 1]))
            return -1;
        s += len;
    }
    return n;
}

struct curve_reader {
    const char *name;
    unsigned line;
    int columns;
    struct rec_curve *out;
    struct pvx_diag *d;
};

static pvx_err curve_add(const struct curve_reader *r, const double v[5])
{
    struct rec_curve *c = r->out;
    if (!(v[0] >= REC_SPECTRAL_LO && v[0] <= REC_SPECTRAL_HI))
        return pvx_fail(r->d, PVX_EINVAL,
                        "%s:%u: wavelength %g is outside %g..%g; it should be in nanometres",
                        r->name, r->line, v[0], REC_SPECTRAL_LO, REC_SPECTRAL_HI);
    if (c->n > 0 && !(v[0] > c->nm[c->n - 1] && v[0] <= c->nm[c->n - 1] + GAP_NM))
        return pvx_fail(r->d, PVX_EINVAL,
                        "%s:%u: wavelength %g nm does not follow %g nm: they should ascend, by at "
                        "most %d nm",
                        r->name, r->line, v[0], c->nm[c->n - 1], GAP_NM);
    if (c->n == REC_CURVE_MAX)
        return pvx_fail(r->d, PVX_ERANGE, "%s:%u: more than %d wavelengths: leave some out",
                        r->name, r->line, REC_CURVE_MAX);
    for (int k = 0; k < r->columns; k++) {
        double most = r->columns == 1 ? 1 : 1e12;
        if (!(v[1 + k] >= 0 && v[1 + k] <= most))
            return pvx_fail(r->d, PVX_EINVAL, "%s:%u: value %g is outside 0..%g", r->name, r->line,
                            v[1 + k], most);
        c->v[k][c->n] = v[1 + k];
    }
    c->nm[c->n++] = v[0];
    return PVX_OK;
}

pvx_err rec_curve_parse(const char *text, size_t len, const char *name, int columns,
                        struct rec_curve *out, struct pvx_diag *d)
{
    struct curve_reader r = {name, 0, columns, out, d};
    const char *end = text + len;
    bool named = false;
    out->n = 0;
    for (const char *s = text; s < end;) {
        const char *stop = memchr(s, '\n', (size_t)(end - s));
        double v[5];
        stop = stop != NULL ? stop : end;
        r.line++;
        int n = *s == '#' ? 0 : line_numbers(s, stop, v);
        s = stop + 1;
        if (n == 0)
            continue;
        if (n < 0 && out->n == 0 && !named) {
            named = true; /* a line of names */
            continue;
        }
        if (n != columns + 1)
            return pvx_fail(d, PVX_EFORMAT, "%s:%u: should be %s", name, r.line,
                            columns == 3 ? "four numbers: wavelength in nm, red, green, blue"
                                         : "two numbers: wavelength in nm and a value from 0 to 1");
        PVX_TRY(curve_add(&r, v));
    }
    return out->n >= 2 ? PVX_OK
                       : pvx_fail(d, PVX_EFORMAT, "%s: %d wavelengths; a curve has 2 or more", name,
                                  out->n);
}

/* ---- values ------------------------------------------------------------------------------------- */

double rec_curve_at(const struct rec_curve *c, int k, double nm, double outside)
{
    int lo = 0, hi = c->n - 1;
    if (!(nm >= c->nm[0] && nm <= c->nm[hi]))
        return outside;
    while (hi - lo > 1) {
        int mid = (lo + hi) / 2;
        *(c->nm[mid] <= nm ? &lo : &hi) = mid;
    }
    double t = (nm - c->nm[lo]) / (c->nm[hi] - c->nm[lo]);
    return (1 - t) * c->v[k][lo] + t * c->v[k][hi];
}

bool rec_curve_covers(const struct rec_curve *c, double from_nm, double to_nm)
{
    return c->nm[0] <= from_nm && c->nm[c->n - 1] >= to_nm;
}

pvx_err rec_curve_response(const struct rec_curve *response, const struct rec_curve *filter,
                           bool quantum, struct rec_spectral *s, struct pvx_diag *d)
{
    const double lo = response->nm[0], hi = response->nm[response->n - 1];
    double most = 0;
    if (filter != NULL && !rec_curve_covers(filter, lo, hi))
        return pvx_fail(d, PVX_EINVAL,
                        "the filter is known from %g to %g nm, and the response from %g to %g nm: "
                        "the filter's file should cover the response's",
                        filter->nm[0], filter->nm[filter->n - 1], lo, hi);
    int n = (int)ceil((hi - lo) / 5 - 1e-9) + 1;
    s->n = n < 2 ? 2 : n > REC_SPECTRAL_MAX ? REC_SPECTRAL_MAX : n;
    s->from = lo;
    s->step = (hi - lo) / (s->n - 1);
    for (int q = 0; q < 3; q++) {
        double sum = 0;
        for (int i = 0; i < s->n; i++) {
            double nm = fmin(lo + i * s->step, hi);
            double v = rec_curve_at(response, q, nm, 0);
            v *= filter != NULL ? rec_curve_at(filter, 0, nm, 0) : 1;
            v *= quantum ? nm / 550 : 1;
            s->response[q][i] = v;
            most = fmax(most, v);
            sum += v;
        }
        if (!(sum > 0))
            return pvx_fail(d, PVX_EINVAL, "the %s channel sees nothing: its response%s is 0",
                            rec_spectral_channel(q), filter != NULL ? " behind the filter" : "");
    }
    for (int q = 0; q < 3; q++)
        for (int i = 0; i < s->n; i++)
            s->response[q][i] /= most;
    return PVX_OK;
}
