#include "recon/check/shift.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FAR    8    /* bins: a search over more than these begins on a coarser picture */
#define NEAR   1    /* whole bins that the steps find without a search */
#define STEPS  2    /* before the step that counts */
#define COARSE 4    /* bins of the picture to a bin of the coarser one */
#define THIN   1e-3 /* smallest ratio of A's eigenvalues at which d is determined */

void rec_smooth(const float *in, int32_t bw, int32_t bh, int passes, float *out, float *tmp)
{
    size_t w = (size_t)bw, h = (size_t)bh;
    memcpy(out, in, w * h * sizeof *out);
    for (int k = 0; k < passes; k++) {
        for (size_t y = 0; y < h; y++)
            for (size_t x = 0; x < w; x++) {
                const float *o = out + y * w;
                tmp[y * w + x] =
                    0.25f * (o[x > 0 ? x - 1 : 0] + 2 * o[x] + o[x + 1 < w ? x + 1 : x]);
            }
        for (size_t y = 0; y < h; y++) {
            const float *a = tmp + (y > 0 ? y - 1 : 0) * w, *b = tmp + y * w,
                        *c = tmp + (y + 1 < h ? y + 1 : y) * w;
            for (size_t x = 0; x < w; x++)
                out[y * w + x] = 0.25f * (a[x] + 2 * b[x] + c[x]);
        }
    }
}

/* Place of b's bin under p's (x,y), -1: outside. */
static int64_t under(const struct rec_pair *q, int32_t x, int32_t y, const int32_t s[2],
                     unsigned flip)
{
    int32_t u = x + s[0], v = y + s[1];
    if (u < 0 || v < 0 || u >= q->bw || v >= q->bh)
        return -1;
    u = (flip & 1) != 0 ? q->bw - 1 - u : u;
    v = (flip & 2) != 0 ? q->bh - 1 - v : v;
    return (int64_t)v * q->bw + u;
}

/* (2) over every step-th bin. */
static double shift_correlate(const struct rec_pair *q, const int32_t s[2], unsigned flip,
                              int32_t step)
{
    double bp = 0, bb = 0, pp = 0;
    for (int32_t y = step / 2; y < q->bh; y += step)
        for (int32_t x = step / 2; x < q->bw; x += step) {
            int64_t i = under(q, x, y, s, flip);
            double p = (double)q->p[(size_t)y * (size_t)q->bw + (size_t)x];
            if (i < 0) { /* light that leaves the picture counts against the shift */
                pp += p * p;
                continue;
            }
            if (!(q->weight[i] > 0))
                continue;
            double b = (double)q->b[i];
            bp += b * p;
            bb += b * b;
            pp += p * p;
        }
    return bb > 0 && pp > 0 ? bp / sqrt(bb * pp) : 0;
}

double rec_correlation(const struct rec_pair *q, const int32_t s[2], unsigned flip)
{
    return shift_correlate(q, s, flip, 1);
}

static double shift_search(const struct rec_pair *q, int32_t reach, int32_t step, unsigned flip,
                           int32_t s[2])
{
    double best = -1;
    int32_t at[2] = {s[0], s[1]};
    for (int32_t dy = -reach; dy <= reach; dy += step)
        for (int32_t dx = -reach; dx <= reach; dx += step) {
            const int32_t t[2] = {at[0] + dx, at[1] + dy};
            double rho = shift_correlate(q, t, flip, step);
            if (rho > best) {
                best = rho;
                s[0] = t[0];
                s[1] = t[1];
            }
        }
    return best;
}

double rec_correlation_peak(const struct rec_pair *q, int32_t reach, unsigned flip, int32_t s[2])
{
    if (reach > FAR) {
        shift_search(q, reach / COARSE * COARSE, COARSE, flip, s);
        reach = COARSE;
    }
    return shift_search(q, reach, 1, flip, s);
}

static struct rec_window *window_at(struct rec_lattice *l, double x, double y, int32_t bw,
                                    int32_t bh)
{
    int i = (int)((x + 0.5) / bw * REC_LATTICE_X), j = (int)((y + 0.5) / bh * REC_LATTICE_Y);
    return &l->w[j * REC_LATTICE_X + i];
}

static bool solve2(const double A[3], const double v[2], double d[2])
{
    double mean = 0.5 * (A[0] + A[2]), gap = hypot(0.5 * (A[0] - A[2]), A[1]);
    double det = A[0] * A[2] - A[1] * A[1];
    d[0] = d[1] = 0;
    if (!(mean - gap > THIN * (mean + gap)) || !(det > 0))
        return false;
    d[0] = (A[2] * v[0] - A[1] * v[1]) / det;
    d[1] = (A[0] * v[1] - A[1] * v[0]) / det;
    return isfinite(d[0]) && isfinite(d[1]);
}

/* p between its bins, 0 outside. */
static double shift_between(const struct rec_pair *q, double x, double y)
{
    if (!(x >= 0) || !(y >= 0) || x >= q->bw - 1 || y >= q->bh - 1)
        return 0;
    size_t w = (size_t)q->bw, i = (size_t)y * w + (size_t)x;
    double fx = x - floor(x), fy = y - floor(y);
    double top = (1 - fx) * (double)q->p[i] + fx * (double)q->p[i + 1];
    double low = (1 - fx) * (double)q->p[i + w] + fx * (double)q->p[i + w + 1];
    return (1 - fy) * top + fy * low;
}

/* alpha of (1) at a displacement d. */
static double scale(const struct rec_pair *q, const double d[2])
{
    double bp = 0, pp = 0;
    for (int32_t y = 0; y < q->bh; y++)
        for (int32_t x = 0; x < q->bw; x++) {
            size_t i = (size_t)y * (size_t)q->bw + (size_t)x;
            double p = shift_between(q, x - d[0], y - d[1]);
            if (!(q->weight[i] > 0) || p == 0)
                continue;
            bp += (double)q->b[i] * p;
            pp += p * p;
        }
    return pp > 0 && bp > 0 ? bp / pp : 0;
}

/* A and v of (1) about d: of all windows into A and v, of each window into sum if that is not NULL. */
static void shift_gather(const struct rec_pair *q, double alpha, const double d[2],
                         struct rec_lattice *sum, double A[3], double v[2])
{
    memset(A, 0, 3 * sizeof *A);
    memset(v, 0, 2 * sizeof *v);
    for (int32_t y = 0; y < q->bh; y++)
        for (int32_t x = 0; x < q->bw; x++) {
            size_t i = (size_t)y * (size_t)q->bw + (size_t)x;
            double X = x - d[0], Y = y - d[1];
            if (!(q->weight[i] > 0) || X < 1 || Y < 1 || X >= q->bw - 2 || Y >= q->bh - 2)
                continue;
            double g[2] = {0.5 * alpha * (shift_between(q, X + 1, Y) - shift_between(q, X - 1, Y)),
                           0.5 * alpha * (shift_between(q, X, Y + 1) - shift_between(q, X, Y - 1))};
            if (g[0] == 0 && g[1] == 0)
                continue;
            double r = (double)q->b[i] - alpha * shift_between(q, X, Y);
            const double e[3] = {g[0] * g[0], g[0] * g[1], g[1] * g[1]};
            const double to[2] = {e[0] * d[0] + e[1] * d[1] - g[0] * r,
                                  e[1] * d[0] + e[2] * d[1] - g[1] * r};
            struct rec_window *o = sum != NULL ? window_at(sum, X, Y, q->bw, q->bh) : NULL;
            for (int a = 0; a < 3; a++) {
                A[a] += e[a];
                if (o != NULL)
                    o->A[a] += e[a];
            }
            for (int a = 0; a < 2; a++) {
                v[a] += to[a];
                if (o != NULL)
                    o->v[a] += to[a];
            }
        }
}

double rec_shift_add(const struct rec_pair *q, const int32_t s[2], struct rec_lattice *sum,
                     double d[2])
{
    bool far = abs(s[0]) > NEAR || abs(s[1]) > NEAR; /* a smaller s may come from noise */
    double alpha = 0, A[3], v[2], at[2] = {far ? s[0] : 0, far ? s[1] : 0};
    d[0] = d[1] = 0;
    for (int step = 0; step < STEPS; step++) {
        double to[2];
        alpha = scale(q, at);
        if (!(alpha > 0) || !isfinite(alpha))
            return 0;
        shift_gather(q, alpha, at, NULL, A, v);
        if (!solve2(A, v, to) || hypot(to[0] - at[0], to[1] - at[1]) > FAR)
            return 0;
        at[0] = to[0];
        at[1] = to[1];
    }
    alpha = scale(q, at);
    shift_gather(q, alpha, at, sum, A, v);
    return solve2(A, v, d) ? alpha : 0;
}

void rec_shift_points(const struct rec_sparse *v, const struct rec_camera *c, int32_t binning,
                      struct rec_lattice *sum)
{
    const struct rec_grid *g = v->grid;
    for (int32_t k = 0; k < v->n; k++) {
        double e = (double)v->value[(size_t)k * (size_t)v->cs], X[3], uv[2];
        int32_t ijk[3];
        if (!(e > 0))
            continue;
        rec_grid_ijk(g, v->index[k], ijk);
        for (int a = 0; a < 3; a++)
            X[a] = g->min[a] + (ijk[a] + 0.5) * rec_grid_h(g, a);
        if (!rec_camera_sees(c, X, uv))
            continue;
        double x = (uv[0] + 0.5) / binning - 0.5, y = (uv[1] + 0.5) / binning - 0.5;
        struct rec_window *o = window_at(sum, x, y, c->width / binning, c->height / binning);
        o->x += e;
        for (int a = 0; a < 3; a++)
            o->X[a] += e * X[a];
    }
}

bool rec_shift_mean(const struct rec_lattice *l, double d[2])
{
    double A[3] = {0}, v[2] = {0};
    for (int i = 0; i < REC_LATTICE; i++) {
        for (int a = 0; a < 3; a++)
            A[a] += l->w[i].A[a];
        for (int a = 0; a < 2; a++)
            v[a] += l->w[i].v[a];
    }
    return solve2(A, v, d);
}

bool rec_shift_window(const struct rec_lattice *l, int i, double d[2], double *weight)
{
    const struct rec_window *w = &l->w[i];
    *weight = w->A[0] + w->A[2];
    return solve2(w->A, w->v, d);
}
