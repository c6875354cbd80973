/* colour.c - converts colours of one camera to those of another. */
#include <string.h>

#include "recon/light/parts.h"

#define WELL 1e-3 /* least eigenvalue of the colours' A'A over its trace */

/* A lower bound of A's least eigenvalue / trace: the product of the other two is largest when they are equal. */
static double colour_condition(const double A[9])
{
    double trace = A[0] + A[4] + A[8];
    double det = A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) +
                 A[2] * (A[3] * A[7] - A[4] * A[6]);
    return 4 * det / (trace * trace * trace);
}

static double size2(const double v[3])
{
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
}

pvx_err rec_light_matrix(const double *from, const double *to, size_t m, double matrix[9],
                         double *residual, struct pvx_diag *d)
{
    double A[9] = {0}, B[9] = {0}, left = 0;
    for (size_t k = 0; k < m; k++) {
        const double *f = from + 3 * k, *t = to + 3 * k;
        for (int i = 0; i < 3 && size2(f) > 0; i++)
            for (int j = 0; j < 3; j++) {
                A[3 * i + j] += f[i] * f[j] / size2(f);
                B[3 * i + j] += t[i] * f[j] / size2(f);
            }
    }
    if (m < 3 || !(colour_condition(A) > WELL))
        return pvx_fail(d, PVX_EINVAL,
                        "%zu %s: show at least three different colours (a red, a green and a blue "
                        "one) to make a matrix",
                        m, m < 3 ? "colours" : "colours that are too alike, or all grey");
    for (int r = 0; r < 3; r++) {
        double M[9];
        memcpy(M, A, sizeof M);
        if (!rec_spd_solve(M, B + 3 * r, 3))
            return pvx_fail(d, PVX_EINVAL, "the colours are too alike to make a matrix");
    }
    memcpy(matrix, B, sizeof B);
    for (size_t k = 0; k < m; k++) {
        const double *f = from + 3 * k;
        for (int r = 0; r < 3 && size2(f) > 0; r++) {
            const double *M = matrix + 3 * r;
            double e = to[3 * k + (size_t)r] - M[0] * f[0] - M[1] * f[1] - M[2] * f[2];
            left += e * e / size2(f);
        }
    }
    *residual = sqrt(left / (double)m);
    return PVX_OK;
}
