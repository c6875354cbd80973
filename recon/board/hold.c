#include "recon/board/hold.h"

#include <math.h>

#include "recon/geom/camera.h"

/* The axes of the board are those of a viewer in front of it: x right, y down, z forward. */
void rec_board_hold(const struct rec_board *b, const double at[3], const double face[3],
                    double roll, double R[9], double t[3])
{
    const double nowhere[3] = {0};
    struct rec_camera who;
    double first[3], last[3];
    rec_camera_look(face, nowhere, &who);
    const double *x = who.R, *y = who.R + 3, *z = who.R + 6;
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
