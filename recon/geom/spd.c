#include "recon/geom/spd.h"

#include <math.h>

bool rec_spd_solve(double *A, double *b, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double s = A[i * n + j];
            for (int k = 0; k < j; k++)
                s -= A[i * n + k] * A[j * n + k];
            if (i != j)
                A[i * n + j] = s / A[j * n + j];
            else if (s > 1e-12 * fabs(A[i * n + i]) && isfinite(s))
                A[i * n + i] = sqrt(s);
            else
                return false;
        }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= A[i * n + k] * b[k];
        b[i] /= A[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= A[k * n + i] * b[k];
        b[i] /= A[i * n + i];
        if (!isfinite(b[i]))
            return false;
    }
    return true;
}
