#include "recon/board/hold.h"

#include <math.h>

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void unit(double v[3])
{
    double n = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; i++)
        v[i] /= n;
}

/* The board's axes as those of somebody who looks at it: x right, y down, z forward. */
void rec_board_hold(const struct rec_board *b, const double at[3], const double face[3],
                    double roll, double R[9], double t[3])
{
    double z[3] = {-face[0], -face[1], -face[2]}, x[3], y[3], first[3], last[3];
    unit(z);
    const double up[3] = {0, 0, 1}, north[3] = {0, 1, 0};
    cross(z, fabs(z[2]) < 0.999 ? up : north, x);
    unit(x);
    cross(z, x, y);
    double c = cos(roll), s = sin(roll);
    for (int i = 0; i < 3; i++) {
        R[3 * i] = c * x[i] + s * y[i];
        R[3 * i + 1] = c * y[i] - s * x[i];
        R[3 * i + 2] = z[i];
    }
    rec_board_point(b, REC_FRONT, 0, first);
    rec_board_point(b, REC_FRONT, rec_board_corners(b) - 1, last);
    for (int i = 0; i < 3; i++)
        t[i] =
            at[i] - 0.5 * (R[3 * i] * (first[0] + last[0]) + R[3 * i + 1] * (first[1] + last[1]));
}
