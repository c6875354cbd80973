#include "recon/geom/glass.h"

#include <float.h>
#include <math.h>

static double glass_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* S of (8) for the unit direction d.  False: d runs along a window, or away from the flame. */
static bool glass_shift(const struct rec_glass *w, int32_t n, const double d[3], double S[3])
{
    S[0] = S[1] = S[2] = 0;
    for (; n > 0; w++, n--) {
        double g = glass_dot(w->normal, d);
        if (!(g > 0))
            return false;
        double by = w->thickness * (1 - g / sqrt(w->index * w->index - 1 + g * g));
        for (int a = 0; a < 3; a++)
            S[a] += by * w->normal[a];
    }
    return true;
}

bool rec_glass_pass(const struct rec_camera *c, double origin[3], const double dir[3])
{
    double S[3], along = 0;
    if (!glass_shift(c->window, c->n_windows, dir, S))
        return false;
    for (int a = 0; a < 3; a++)
        origin[a] += S[a];
    for (int32_t i = 0; i < c->n_windows; i++) {
        const struct rec_glass *w = &c->window[i];
        double s =
            (w->at + w->thickness - glass_dot(w->normal, origin)) / glass_dot(w->normal, dir);
        along = s > along ? s : along;
    }
    for (int a = 0; a < 3; a++)
        origin[a] += along * dir[a];
    return true;
}

static bool glass_behind(const struct rec_camera *c, const double X[3])
{
    for (int32_t i = 0; i < c->n_windows; i++) {
        const struct rec_glass *w = &c->window[i];
        if (!(glass_dot(w->normal, X) >= w->at + w->thickness))
            return false;
    }
    return true;
}

/* A = d (Y + S(Y/|Y|)) / dY, row major. */
static void glass_matrix(const struct rec_glass *w, int32_t n, const double Y[3], double A[9])
{
    double y = sqrt(glass_dot(Y, Y));
    for (int i = 0; i < 9; i++)
        A[i] = i % 4 == 0;
    for (; n > 0; w++, n--) {
        double g = glass_dot(w->normal, Y) / y, m = w->index * w->index - 1, q = sqrt(m + g * g);
        double slope = -w->thickness * m / (q * q * q * y);
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++)
                A[3 * r + k] += slope * w->normal[r] * (w->normal[k] - g * Y[k] / y);
    }
}

/* Inverse by cofactors.  False: singular. */
static bool glass_invert(const double A[9], double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int r = (j + 1) % 3, s = (j + 2) % 3, k = (i + 1) % 3, l = (i + 2) % 3;
            out[3 * i + j] = A[3 * r + k] * A[3 * s + l] - A[3 * r + l] * A[3 * s + k];
        }
    double det = A[0] * out[0] + A[1] * out[3] + A[2] * out[6];
    for (int i = 0; i < 9; i++)
        out[i] /= det;
    return fabs(det) > 1e-12;
}

/* Behind one plate the lateral part
 * is a concave, rising function of the tangent of the angle, and the straight line starts below the root: Newton's steps
 * go up to it and never beyond.  For plates that are not parallel, steps that do not help are halved. */
bool rec_glass_solve(const struct rec_glass *w, int32_t n, const double W[3], double Y[3])
{
    double y = sqrt(glass_dot(W, W)), F[3], d[3], S[3], A[9], B[9], best = INFINITY, step[3] = {0};
    double from[3] = {W[0], W[1], W[2]}, share = 1;
    const double reach = y;
    for (int it = 0; it < 60; it++) {
        for (int a = 0; a < 3; a++)
            Y[a] = from[a] - share * step[a];
        y = sqrt(glass_dot(Y, Y));
        for (int a = 0; a < 3; a++)
            d[a] = Y[a] / y;
        bool through = glass_shift(w, n, d, S);
        for (int a = 0; a < 3; a++)
            F[a] = Y[a] + S[a] - W[a];
        double off = through ? sqrt(glass_dot(F, F)) : INFINITY;
        if (!(off < best)) { /* at rounding, or too long a step */
            if (best <= 64 * DBL_EPSILON * reach || share < 1e-3) {
                for (int a = 0; a < 3; a++)
                    Y[a] = from[a];
                return best <= 1e-12 * reach;
            }
            share *= 0.5;
            continue;
        }
        best = off;
        share = 1;
        glass_matrix(w, n, Y, A);
        if (off == 0 || !glass_invert(A, B))
            return off == 0;
        for (int a = 0; a < 3; a++) {
            from[a] = Y[a];
            step[a] = glass_dot(B + 3 * a, F);
        }
    }
    return best <= 1e-12 * reach;
}

bool rec_glass_inverse(const struct rec_glass *w, int32_t n, const double Y[3], double B[9])
{
    double A[9];
    glass_matrix(w, n, Y, A);
    return glass_invert(A, B);
}

bool rec_glass_apparent(const struct rec_camera *c, const double X[3], double P[3])
{
    double centre[3], W[3], Y[3];
    if (!glass_behind(c, X))
        return false;
    if (c->model == REC_TELECENTRIC) {
        if (!glass_shift(c->window, c->n_windows, c->R + 6, Y))
            return false;
        for (int a = 0; a < 3; a++)
            P[a] = X[a] - Y[a];
        return true;
    }
    rec_camera_centre(c, centre);
    for (int a = 0; a < 3; a++)
        W[a] = X[a] - centre[a];
    if (!rec_glass_solve(c->window, c->n_windows, W, Y))
        return false;
    for (int a = 0; a < 3; a++)
        P[a] = centre[a] + Y[a];
    return true;
}

bool rec_glass_slopes(const struct rec_camera *c, const double P[3], double D[6])
{
    double centre[3], Y[3], B[9], w[3], v[3];
    rec_camera_centre(c, centre);
    for (int a = 0; a < 3; a++)
        Y[a] = P[a] - centre[a];
    if (!rec_glass_inverse(c->window, c->n_windows, Y, B))
        return false;
    for (int r = 0; r < 2; r++) { /* D R A^-1 R^T */
        double *g = D + 3 * r;
        for (int a = 0; a < 3; a++)
            w[a] = g[0] * c->R[a] + g[1] * c->R[3 + a] + g[2] * c->R[6 + a];
        for (int a = 0; a < 3; a++)
            v[a] = w[0] * B[a] + w[1] * B[3 + a] + w[2] * B[6 + a];
        for (int a = 0; a < 3; a++)
            g[a] = glass_dot(v, c->R + 3 * a);
    }
    return true;
}

/* With s(g) = |S| of one plate, m = n^2 - 1 and q^2 = m + g^2: s' = -T m / q^3, s'' = 3 T m g / q^5.  Along a line
 * |g'| <= 1/|Y| and |g''| <= 3/|Y|^2, so |S''| <= T (3 m g / q^5 + 3 m / q^3) / |Y|^2.  Pixels per metre are taken at the
 * corners.  All of it is doubled for what the corners do not show. */
double rec_glass_bend(const struct rec_camera *c, const struct rec_grid *g)
{
    double least[REC_WINDOWS], near = INFINITY, steep = 0, centre[3], bend = 0;
    rec_camera_centre(c, centre);
    for (int32_t i = 0; i < c->n_windows; i++)
        least[i] = 1;
    for (int i = 0; i < 8; i++) {
        double X[3], P[3], Y[3], D[6];
        struct rec_projection p;
        for (int a = 0; a < 3; a++)
            X[a] = i >> a & 1 ? g->max[a] + 0.5 * rec_grid_h(g, a)
                              : g->min[a] - 0.5 * rec_grid_h(g, a);
        if (!rec_camera_slopes(c, X, &p, D) || !rec_glass_apparent(c, X, P))
            return -1;
        for (int a = 0; a < 3; a++)
            Y[a] = P[a] - centre[a];
        double y = sqrt(glass_dot(Y, Y));
        near = fmin(near, c->R[6] * Y[0] + c->R[7] * Y[1] + c->R[8] * Y[2]); /* |Y| at least */
        for (int32_t k = 0; k < c->n_windows; k++)
            least[k] = fmin(least[k], glass_dot(c->window[k].normal, Y) / y);
        for (int r = 0; r < 2; r++)
            steep = fmax(steep, sqrt(glass_dot(D + 3 * r, D + 3 * r)));
    }
    for (int32_t i = 0; i < c->n_windows; i++) {
        const struct rec_glass *w = &c->window[i];
        double m = w->index * w->index - 1, q = sqrt(m + least[i] * least[i]);
        bend += w->thickness * 3 * m / (q * q * q) * (1 + 1 / (q * q));
    }
    return 2 * bend * steep / (near * near);
}
