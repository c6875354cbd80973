#include "recon/calib/model.h"

#include <math.h>
#include <string.h>

#include "recon/calib/pose.h"
#include "recon/geom/glass.h"

static bool model_lens(const double l[9], const double X[3], double uv[2], double *Jl, double *JX)
{
    if (!(X[2] > 1e-6))
        return false;
    double iz = 1 / X[2], x = X[0] * iz, y = X[1] * iz, r2 = x * x + y * y;
    double k1 = l[4], k2 = l[5], p1 = l[6], p2 = l[7], k3 = l[8];
    double c = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    double xd = c * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
    double yd = c * y + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
    uv[0] = l[0] * xd + l[2];
    uv[1] = l[1] * yd + l[3];
    if (Jl != NULL) {
        const double d[2][9] = {{xd, 0, 1, 0, l[0] * x * r2, l[0] * x * r2 * r2, l[0] * 2 * x * y,
                                 l[0] * (r2 + 2 * x * x), l[0] * x * r2 * r2 * r2},
                                {0, yd, 0, 1, l[1] * y * r2, l[1] * y * r2 * r2,
                                 l[1] * (r2 + 2 * y * y), l[1] * 2 * x * y,
                                 l[1] * y * r2 * r2 * r2}};
        memcpy(Jl, d, sizeof d);
    }
    if (JX != NULL) {
        double s = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3)); /* 2 dc/dr2 */
        double xx = c + s * x * x + 2 * p1 * y + 6 * p2 * x;
        double xy = s * x * y + 2 * p1 * x + 2 * p2 * y;
        double yy = c + s * y * y + 6 * p1 * y + 2 * p2 * x;
        JX[0] = l[0] * xx * iz;
        JX[1] = l[0] * xy * iz;
        JX[2] = -l[0] * (xx * x + xy * y) * iz;
        JX[3] = l[1] * xy * iz;
        JX[4] = l[1] * yy * iz;
        JX[5] = -l[1] * (xy * x + yy * y) * iz;
    }
    return true;
}

bool rec_model_project(const struct rec_model *m, const double X[3], double uv[2], double *Jl,
                       double *JX)
{
    double Y[3], B[9];
    if (m->windows == 0)
        return model_lens(m->lens, X, uv, Jl, JX);
    if (!(X[2] > 1e-6) || !rec_glass_solve(m->window, m->windows, X, Y) ||
        !model_lens(m->lens, Y, uv, Jl, JX))
        return false;
    if (JX == NULL)
        return true;
    if (!rec_glass_inverse(m->window, m->windows, Y, B))
        return false;
    for (int r = 0; r < 2; r++) {
        const double *g = JX + 3 * r, h[3] = {g[0], g[1], g[2]};
        for (int a = 0; a < 3; a++)
            JX[3 * r + a] = h[0] * B[a] + h[1] * B[3 + a] + h[2] * B[6 + a];
    }
    return true;
}

bool rec_model_ideal(const double l[9], const double uv[2], double xy[2])
{
    double xd = (uv[0] - l[2]) / l[0], yd = (uv[1] - l[3]) / l[1], x = xd, y = yd;
    for (int i = 0; i < 50; i++) {
        double r2 = x * x + y * y, c = 1 + r2 * (l[4] + r2 * (l[5] + r2 * l[8]));
        if (!(c > 0.1))
            return false;
        x = (xd - 2 * l[6] * x * y - l[7] * (r2 + 2 * x * x)) / c;
        y = (yd - l[6] * (r2 + 2 * y * y) - 2 * l[7] * x * y) / c;
    }
    xy[0] = x;
    xy[1] = y;
    return isfinite(x) && isfinite(y);
}

void rec_model_move(const double pose[6], const double X[3], double out[3], double *J, double *R)
{
    double own[9], L[9], Y[3];
    if (R == NULL)
        R = own;
    rec_rotation_left(pose, R, J != NULL ? L : NULL);
    for (int i = 0; i < 3; i++) {
        Y[i] = R[3 * i] * X[0] + R[3 * i + 1] * X[1] + R[3 * i + 2] * X[2];
        out[i] = Y[i] + pose[3 + i];
    }
    for (int c = 0; c < 3 && J != NULL; c++) { /* (L dw) x Y */
        const double a[3] = {L[c], L[3 + c], L[6 + c]};
        J[c] = a[1] * Y[2] - a[2] * Y[1];
        J[6 + c] = a[2] * Y[0] - a[0] * Y[2];
        J[12 + c] = a[0] * Y[1] - a[1] * Y[0];
        for (int r = 0; r < 3; r++)
            J[6 * r + 3 + c] = r == c;
    }
}

bool rec_model_see(const struct rec_model *m, const double pose[6], const double X[3], double Z[3],
                   double uv[2], double *A, double *G)
{
    double Jl[18], JX[6], Jp[18], R[9];
    rec_model_move(pose, X, Z, Jp, R);
    if (!rec_model_project(m, Z, uv, Jl, JX))
        return false;
    for (int r = 0; r < 2; r++) {
        const double *j = JX + 3 * r;
        memcpy(A + 15 * r, Jl + 9 * r, 9 * sizeof *A);
        for (int i = 0; i < 6; i++)
            A[15 * r + 9 + i] = j[0] * Jp[i] + j[1] * Jp[6 + i] + j[2] * Jp[12 + i];
        for (int i = 0; i < 3 && G != NULL; i++)
            G[3 * r + i] = j[0] * R[i] + j[1] * R[3 + i] + j[2] * R[6 + i];
    }
    return true;
}

void rec_model_turn(const double Y[3], const double G[6], double B[12])
{
    for (int r = 0; r < 2; r++)
        for (int i = 0; i < 3; i++) {
            int p = (i + 1) % 3, q = (i + 2) % 3;
            B[6 * r + i] = Y[p] * G[3 * r + q] - Y[q] * G[3 * r + p];
            B[6 * r + 3 + i] = G[3 * r + i];
        }
}
