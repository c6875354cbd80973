#include "recon/calib/pose.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

void rec_mat3(const double A[9], const double B[9], double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

/* I + a [w]x + b [w]x^2 */
static void series(const double w[3], double a, double b, double out[9])
{
    double x = w[0], y = w[1], z = w[2], t2 = x * x + y * y + z * z;
    double S[9] = {0, -z, y, z, 0, -x, -y, x, 0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = a * S[3 * i + j] + b * w[i] * w[j] + (i == j ? 1 - b * t2 : 0);
}

void rec_rotation_left(const double w[3], double R[9], double J[9])
{
    double t2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], t = sqrt(t2);
    double a = 1 - t2 / 6, b = 0.5 - t2 / 24, c = 1.0 / 6 - t2 / 120;
    if (t > 1e-4) {
        a = sin(t) / t;
        b = (1 - cos(t)) / t2;
        c = (1 - a) / t2;
    }
    series(w, a, b, R);
    if (J != NULL)
        series(w, b, c, J);
}

void rec_rotation(const double w[3], double R[9])
{
    rec_rotation_left(w, R, NULL);
}

/* By the quaternion, from its largest component: exact near half a turn too. */
void rec_rotation_log(const double R[9], double w[3])
{
    double four[4] = {1 + R[0] + R[4] + R[8], 1 + R[0] - R[4] - R[8], 1 - R[0] + R[4] - R[8],
                      1 - R[0] - R[4] + R[8]};
    int k = 0;
    for (int i = 1; i < 4; i++)
        if (four[i] > four[k])
            k = i;
    double q[4], d[3] = {R[7] - R[5], R[2] - R[6], R[3] - R[1]};
    double s[3] = {R[5] + R[7], R[2] + R[6], R[1] + R[3]}; /* yz, xz, xy */
    q[k] = four[k];
    if (k == 0) {
        memcpy(q + 1, d, sizeof d);
    } else {
        q[0] = d[k - 1];
        for (int i = 1; i < 4; i++)
            if (i != k)
                q[i] = s[6 - k - i - 1];
    }
    if (q[0] < 0)
        for (int i = 0; i < 4; i++)
            q[i] = -q[i];
    double n = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double f = n > 1e-12 * q[0] ? 2 * atan2(n, q[0]) / n : 2 / q[0];
    for (int i = 0; i < 3; i++)
        w[i] = f * q[1 + i];
}

void rec_pose_apply(const double a[6], const double X[3], double out[3])
{
    double R[9];
    rec_rotation(a, R);
    for (int i = 0; i < 3; i++)
        out[i] = R[3 * i] * X[0] + R[3 * i + 1] * X[1] + R[3 * i + 2] * X[2] + a[3 + i];
}

void rec_pose_mul(const double a[6], const double b[6], double out[6])
{
    double A[9], B[9], C[9], t[3];
    rec_rotation(a, A);
    rec_rotation(b, B);
    rec_mat3(A, B, C);
    rec_pose_apply(a, b + 3, t);
    rec_rotation_log(C, out);
    memcpy(out + 3, t, sizeof t);
}

void rec_pose_inverse(const double a[6], double out[6])
{
    double w[3] = {-a[0], -a[1], -a[2]}, R[9];
    rec_rotation(w, R);
    double t[3];
    for (int i = 0; i < 3; i++)
        t[i] = -(R[3 * i] * a[3] + R[3 * i + 1] * a[4] + R[3 * i + 2] * a[5]);
    memcpy(out, w, sizeof w);
    memcpy(out + 3, t, sizeof t);
}

double rec_pose_distance(const double a[6], const double b[6], double reach)
{
    double A[9], B[9], C[9], w[3], d2 = 0;
    double minus[3] = {-a[0], -a[1], -a[2]};
    rec_rotation(minus, A);
    rec_rotation(b, B);
    rec_mat3(A, B, C);
    rec_rotation_log(C, w);
    for (int i = 0; i < 3; i++)
        d2 += (a[3 + i] - b[3 + i]) * (a[3 + i] - b[3 + i]);
    return sqrt(d2) + reach * sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
}

/* Eigenvector of the largest eigenvalue of a symmetric 4x4 matrix, by Jacobi's rotations. */
static void largest4(double A[4][4], double q[4])
{
    double V[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    for (int sweep = 0; sweep < 50; sweep++)
        for (int p = 0; p < 3; p++)
            for (int r = p + 1; r < 4; r++) {
                if (A[p][r] == 0)
                    continue;
                double h = (A[r][r] - A[p][p]) / (2 * A[p][r]);
                double t = (h >= 0 ? 1 : -1) / (fabs(h) + sqrt(h * h + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 4; k++) {
                    double x = A[k][p], y = A[k][r];
                    A[k][p] = c * x - s * y;
                    A[k][r] = s * x + c * y;
                }
                for (int k = 0; k < 4; k++) {
                    double x = A[p][k], y = A[r][k];
                    A[p][k] = c * x - s * y;
                    A[r][k] = s * x + c * y;
                    x = V[k][p], y = V[k][r];
                    V[k][p] = c * x - s * y;
                    V[k][r] = s * x + c * y;
                }
            }
    int best = 0;
    for (int k = 1; k < 4; k++)
        if (A[k][k] > A[best][best])
            best = k;
    for (int k = 0; k < 4; k++)
        q[k] = V[k][best];
}

void rec_pose_align(const double (*a)[3], const double (*b)[3], const double *weight, int n,
                    double out[6], double *scale)
{
    double ma[3] = {0}, mb[3] = {0}, sum = 0, M[3][3] = {{0}}, aa = 0, bb = 0;
    for (int i = 0; i < n; i++) {
        sum += weight[i];
        for (int k = 0; k < 3; k++) {
            ma[k] += weight[i] * a[i][k];
            mb[k] += weight[i] * b[i][k];
        }
    }
    for (int k = 0; k < 3; k++) {
        ma[k] /= sum;
        mb[k] /= sum;
    }
    for (int i = 0; i < n; i++)
        for (int r = 0; r < 3; r++) {
            double x = a[i][r] - ma[r], y = b[i][r] - mb[r];
            aa += weight[i] * x * x;
            bb += weight[i] * y * y;
            for (int c = 0; c < 3; c++)
                M[r][c] += weight[i] * x * (b[i][c] - mb[c]);
        }
    double N[4][4] = {
        {M[0][0] + M[1][1] + M[2][2], M[1][2] - M[2][1], M[2][0] - M[0][2], M[0][1] - M[1][0]},
        {0, M[0][0] - M[1][1] - M[2][2], M[0][1] + M[1][0], M[2][0] + M[0][2]},
        {0, 0, -M[0][0] + M[1][1] - M[2][2], M[1][2] + M[2][1]},
        {0, 0, 0, -M[0][0] - M[1][1] + M[2][2]}};
    for (int r = 1; r < 4; r++)
        for (int c = 0; c < r; c++)
            N[r][c] = N[c][r];
    double q[4];
    largest4(N, q);
    double s = q[0] < 0 ? -1 : 1, v = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double f = v > 1e-15 ? 2 * atan2(v, s * q[0]) / v : 2;
    for (int k = 0; k < 3; k++) {
        out[k] = s * f * q[1 + k];
        out[3 + k] = 0;
    }
    double turned[3];
    rec_pose_apply(out, ma, turned);
    for (int k = 0; k < 3; k++)
        out[3 + k] = mb[k] - turned[k];
    if (scale != NULL)
        *scale = aa > 0 ? sqrt(bb / aa) : 1;
}
