/* response.c - light of a sample from a series of exposures. */
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/light/parts.h"

enum { N = REC_RESPONSE_KNOTS, FREE = N - 1, MOST = 64, PIXELS = 4000, ROUNDS = 20 };

#define SMOOTH 1e-5  /* weight of r'' relative to that of all samples */
#define FULL   0.985 /* above it saturation cuts off noise */

struct ladder {
    const struct rec_light_picture *p;
    size_t m;
    double A[FREE * FREE],
        B[FREE * FREE]; /* of (2): rest of r after a line, rest after a constant */
    double all;         /* sum of the weights */
};

/* The usable samples of one pixel. */
struct samples {
    int n;
    double s[MOST], t[MOST], w[MOST];
};

static struct samples response_take(const struct ladder *l, size_t i)
{
    struct samples a = {0};
    double most = 0;
    for (size_t k = 0; k < l->m; k++) {
        most = fmax(most, l->p[k].exposure);
        double s = (double)l->p[k].mean[i];
        if (!(s >= 0 && s < FULL))
            continue;
        a.s[a.n] = s;
        a.t[a.n++] = l->p[k].exposure;
    }
    for (int k = 0; k < a.n; k++)
        a.w[k] = pow(a.t[k] / most + 0.1, -2);
    return a;
}

/* The rest of v [n] after a fit of a + b t, or of a alone (`constant`).  v may be values or the knots'
 * coefficients. */
static void response_project(const struct samples *a, const double *v, size_t stride, bool constant,
                             double *out)
{
    double w = 0, wt = 0, wtt = 0, wv = 0, wtv = 0;
    for (int k = 0; k < a->n; k++) {
        double x = v[(size_t)k * stride];
        w += a->w[k];
        wt += a->w[k] * a->t[k];
        wtt += a->w[k] * a->t[k] * a->t[k];
        wv += a->w[k] * x;
        wtv += a->w[k] * a->t[k] * x;
    }
    double slope = constant ? 0 : (w * wtv - wt * wv) / (w * wtt - wt * wt);
    double at0 = (wv - slope * wt) / w;
    for (int k = 0; k < a->n; k++)
        out[(size_t)k * stride] = v[(size_t)k * stride] - at0 - slope * a->t[k];
}

/* Adds one pixel to (2). */
static void response_add(struct ladder *l, const struct samples *a)
{
    static _Thread_local double knot[MOST * N], left[MOST * N];
    memset(knot, 0, sizeof knot);
    for (int k = 0; k < a->n; k++) {
        double at = a->s[k] * (N - 1);
        int i = at < N - 2 ? (int)at : N - 2;
        knot[k * N + i] = 1 - (at - i);
        knot[k * N + i + 1] = at - i;
    }
    for (int constant = 0; constant < 2; constant++) {
        double *to = constant ? l->B : l->A;
        for (int i = 0; i < N; i++)
            response_project(a, knot + i, N, constant, left + i);
        for (int k = 0; k < a->n; k++) {
            const double *r = left + (size_t)k * N + 1; /* r(0) = 0 */
            for (int i = 0; i < FREE; i++)
                for (int j = 0; j < FREE; j++)
                    to[i * FREE + j] += a->w[k] * r[i] * r[j];
        }
    }
    for (int k = 0; k < a->n; k++)
        l->all += a->w[k];
}

static void response_smooth(struct ladder *l)
{
    double h = SMOOTH * l->all;
    for (int i = 1; i < N - 1; i++)
        for (int a = -1; a <= 1; a++)
            for (int b = -1; b <= 1; b++) {
                int r = i + a - 1, c = i + b - 1;
                if (r >= 0 && c >= 0)
                    l->A[r * FREE + c] += h * (a == 0 ? -2 : 1) * (b == 0 ? -2 : 1);
            }
}

/* The r with the least (2), by inverse iteration from a straight line, scaled to r(1) = 1. */
static bool response_least(const struct ladder *l, double v[N])
{
    static _Thread_local double M[FREE * FREE];
    for (int i = 0; i < N; i++)
        v[i] = (double)i / (N - 1);
    for (int round = 0; round < ROUNDS; round++) {
        double b[FREE] = {0};
        for (int i = 0; i < FREE; i++)
            for (int j = 0; j < FREE; j++)
                b[i] += l->B[i * FREE + j] * v[j + 1];
        memcpy(M, l->A, sizeof M);
        if (!rec_spd_solve(M, b, FREE) || !(fabs(b[FREE - 1]) > 0))
            return false;
        for (int i = 0; i < FREE; i++)
            v[i + 1] = b[i] / b[FREE - 1];
    }
    return true;
}

/* Pool adjacent violators; Ayer et al., Ann. Math. Stat. 26:641, 1955. */
static void monotone(double v[N])
{
    double sum[N];
    int count[N], blocks = 0;
    for (int i = 0; i < N; i++) {
        sum[blocks] = v[i];
        count[blocks++] = 1;
        while (blocks > 1 &&
               sum[blocks - 2] / count[blocks - 2] > sum[blocks - 1] / count[blocks - 1]) {
            sum[blocks - 2] += sum[blocks - 1];
            count[blocks - 2] += count[blocks - 1];
            blocks--;
        }
    }
    for (int b = 0, i = 0; b < blocks; b++)
        for (int k = 0; k < count[b]; k++, i++)
            v[i] = fmin(fmax(sum[b] / count[b], 0), 1);
    v[0] = 0;
    v[N - 1] = 1;
}

static double response_at(const double v[N], double s)
{
    double x = s * (N - 1);
    int i = x < N - 2 ? (int)x : N - 2;
    return v[i] + (v[i + 1] - v[i]) * (x - i);
}

/* Exposures 1 q q^2 q^3 ...: r(s) (1 + a sin(2 pi log_q r(s))) would then fit as well as r. */
static bool one_ratio(const struct rec_light_picture *p, size_t m)
{
    double t[MOST], least = INFINITY, most = 0;
    for (size_t k = 0; k < m; k++)
        t[k] = log(p[k].exposure);
    qsort(t, m, sizeof *t, pvx_ascending);
    for (size_t k = 1; k < m; k++)
        if (t[k] - t[k - 1] > 0.02) {
            least = fmin(least, t[k] - t[k - 1]);
            most = fmax(most, t[k] - t[k - 1]);
        }
    return most < 1.1 * least;
}

static pvx_err response_possible(const struct rec_light_picture *p, size_t m, struct pvx_diag *d)
{
    size_t n = rec_light_pixels(p) * (size_t)p->channels;
    if (m < 4 || m > MOST)
        return pvx_fail(d, PVX_EINVAL, "%zu exposures: a response needs 4 to %d, from dark to full",
                        m, MOST);
    for (size_t k = 0; k < m; k++)
        if (!(p[k].exposure > 0))
            return pvx_fail(d, PVX_EINVAL, "picture %zu: its exposure is not known (--exposure)",
                            k + 1);
    if (one_ratio(p, m))
        return pvx_fail(
            d, PVX_EINVAL,
            "the exposures are all in one ratio, which hides waves in the response: make the "
            "steps uneven, as 1 1.4 2.2 3 4.6 ...");
    for (size_t k = 0; k < m; k++)
        for (size_t q = 0; q < m; q++) {
            size_t falls = 0, both = 0;
            if (!(p[q].exposure > 1.02 * p[k].exposure))
                continue;
            for (size_t i = 0; i < n; i += n / PIXELS + 1) {
                double a = (double)p[k].mean[i], b = (double)p[q].mean[i];
                if (!(a < FULL))
                    continue;
                both++;
                falls += b < a - 4 * sqrt(((double)p[k].var[i] + (double)p[q].var[i]) / 2) - 0.002;
            }
            if (falls * 2 > both)
                return pvx_fail(
                    d, PVX_EINVAL,
                    "the samples fall while the exposure rises from %.6g to %.6g ms: the "
                    "light changed, the exposure was automatic, or pictures were exchanged",
                    p[k].exposure * 1e3, p[q].exposure * 1e3);
        }
    return PVX_OK;
}

pvx_err rec_light_response(const struct rec_light_picture *p, size_t m, struct rec_response *out,
                           struct pvx_diag *d)
{
    PVX_TRY(response_possible(p, m, d));
    size_t n = rec_light_pixels(p) * (size_t)p->channels,
           step = n / PIXELS | 1; /* odd: both colours of a row */
    double low = 1, high = 0, sum = 0;
    struct ladder *l = pvx_calloc(1, sizeof *l);
    PVX_NEED(l);
    l->p = p;
    l->m = m;
    for (size_t i = 0; i < n; i += step) {
        struct samples a = response_take(l, i);
        for (int k = 0; k < a.n; k++) {
            low = fmin(low, a.s[k]);
            high = fmax(high, a.s[k]);
        }
        if (a.n >= 3)
            response_add(l, &a);
    }
    pvx_err e = PVX_OK;
    if (low > 0.1 || high < 0.9)
        e = pvx_fail(
            d, PVX_EINVAL,
            "the samples cover %.0f to %.0f %% of the range only: take exposures from nearly "
            "dark to nearly full",
            100 * low, 100 * high);
    response_smooth(l);
    if (e == PVX_OK && !response_least(l, out->value))
        e = pvx_fail(d, PVX_EINVAL,
                     "these exposures do not determine a response: take more of them");
    if (e == PVX_OK) {
        monotone(out->value);
        for (size_t i = 0; i < n; i += step) {
            struct samples a = response_take(l, i);
            double v[MOST], left[MOST];
            for (int k = 0; k < a.n; k++)
                v[k] = response_at(out->value, a.s[k]);
            if (a.n >= 3)
                response_project(&a, v, 1, false, left);
            for (int k = 0; k < a.n && a.n >= 3; k++)
                sum += a.w[k] * left[k] * left[k];
        }
        out->residual = sqrt(sum / l->all);
    }
    free(l);
    return e;
}
