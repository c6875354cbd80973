#include "recon/board/homography.h"
#include "recon/geom/spd.h"

#include <math.h>

/* Centre and spread of the weighted points: (x - c[0]) / c[2]. */
static bool normaliser(const struct rec_pair *p, size_t n, bool picture, double c[3])
{
    double w = 0, sx = 0, sy = 0, ss = 0;
    for (size_t i = 0; i < n; i++) {
        w += p[i].weight;
        sx += p[i].weight * (picture ? p[i].u : p[i].x);
        sy += p[i].weight * (picture ? p[i].v : p[i].y);
    }
    c[0] = sx / w;
    c[1] = sy / w;
    for (size_t i = 0; i < n; i++) {
        double x = (picture ? p[i].u : p[i].x) - c[0], y = (picture ? p[i].v : p[i].y) - c[1];
        ss += p[i].weight * (x * x + y * y);
    }
    c[2] = sqrt(ss / w);
    return isfinite(c[2]) && c[2] > 0;
}

static void homography_add_row(double A[64], double b[8], const double row[8], double value,
                               double weight)
{
    for (int i = 0; i < 8; i++) {
        if (row[i] == 0)
            continue;
        for (int j = 0; j <= i; j++)
            A[i * 8 + j] += weight * row[i] * row[j];
        b[i] += weight * row[i] * value;
    }
}

static void homography_multiply(const double a[9], const double b[9], double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[i * 3 + j] = a[i * 3] * b[j] + a[i * 3 + 1] * b[3 + j] + a[i * 3 + 2] * b[6 + j];
}

bool rec_homography_fit(const struct rec_pair *p, size_t n, double h[9])
{
    double A[64] = {0}, b[8] = {0}, c[3], g[3], t[9];
    if (n < 4 || !normaliser(p, n, false, c) || !normaliser(p, n, true, g))
        return false;
    for (size_t i = 0; i < n; i++) {
        double x = (p[i].x - c[0]) / c[2], y = (p[i].y - c[1]) / c[2];
        double u = (p[i].u - g[0]) / g[2], v = (p[i].v - g[1]) / g[2];
        homography_add_row(A, b, (double[8]){x, y, 1, 0, 0, 0, -u * x, -u * y}, u, p[i].weight);
        homography_add_row(A, b, (double[8]){0, 0, 0, x, y, 1, -v * x, -v * y}, v, p[i].weight);
    }
    if (!rec_spd_solve(A, b, 8))
        return false;
    double k[9] = {b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], 1};
    double in[9] = {1 / c[2], 0, -c[0] / c[2], 0, 1 / c[2], -c[1] / c[2], 0, 0, 1};
    double out[9] = {g[2], 0, g[0], 0, g[2], g[1], 0, 0, 1};
    homography_multiply(k, in, t);
    homography_multiply(out, t, h);
    return true;
}

bool rec_homography_inverse(const double h[9], double o[9])
{
    double r[9] = {h[4] * h[8] - h[5] * h[7], h[2] * h[7] - h[1] * h[8], h[1] * h[5] - h[2] * h[4],
                   h[5] * h[6] - h[3] * h[8], h[0] * h[8] - h[2] * h[6], h[2] * h[3] - h[0] * h[5],
                   h[3] * h[7] - h[4] * h[6], h[1] * h[6] - h[0] * h[7], h[0] * h[4] - h[1] * h[3]};
    double det = h[0] * r[0] + h[1] * r[3] + h[2] * r[6];
    if (!isfinite(det) || det == 0)
        return false;
    for (int i = 0; i < 9; i++)
        o[i] = r[i] / det;
    return true;
}

void rec_homography_map(const double h[9], double x, double y, double uv[2])
{
    double w = h[6] * x + h[7] * y + h[8];
    uv[0] = (h[0] * x + h[1] * y + h[2]) / w;
    uv[1] = (h[3] * x + h[4] * y + h[5]) / w;
}

void rec_homography_jacobian(const double h[9], double x, double y, double duv[4])
{
    double uv[2], w = h[6] * x + h[7] * y + h[8];
    rec_homography_map(h, x, y, uv);
    duv[0] = (h[0] - uv[0] * h[6]) / w;
    duv[1] = (h[1] - uv[0] * h[7]) / w;
    duv[2] = (h[3] - uv[1] * h[6]) / w;
    duv[3] = (h[4] - uv[1] * h[7]) / w;
}
