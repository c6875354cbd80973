#include "recon/check/gauge.h"

#include <math.h>
#include <string.h>

#include "recon/calib/pose.h"
#include "recon/geom/spd.h"

enum { POINTS = REC_GAUGE_SIDE * REC_GAUGE_SIDE * REC_GAUGE_SIDE, ROUNDS = 4 };

static void rotate(const double R[9], const double X[3], double out[3])
{
    for (int a = 0; a < 3; a++)
        out[a] = R[3 * a] * X[0] + R[3 * a + 1] * X[1] + R[3 * a + 2] * X[2];
}

static void gauge_middle(const struct rec_grid *g, double X[3])
{
    for (int a = 0; a < 3; a++)
        X[a] = 0.5 * (g->min[a] + g->max[a]);
}

static void gauge_point(const struct rec_grid *g, int i, double X[3])
{
    for (int a = 0; a < 3; a++, i /= REC_GAUGE_SIDE)
        X[a] = g->min[a] + (i % REC_GAUGE_SIDE + 0.5) / REC_GAUGE_SIDE * (g->max[a] - g->min[a]);
}

void rec_camera_nudge(struct rec_camera *c, const double X0[3], const double w[3],
                      const double t[3])
{
    double D[9], R[9], Y0[3], Y[3], arm[3];
    rec_rotation(w, D);
    rotate(c->R, X0, Y0);
    for (int a = 0; a < 3; a++) {
        Y0[a] += c->t[a];
        arm[a] = c->t[a] - Y0[a];
    }
    rotate(D, arm, Y);
    rec_mat3(D, c->R, R);
    memcpy(c->R, R, sizeof R);
    for (int a = 0; a < 3; a++)
        c->t[a] = Y0[a] + Y[a] + t[a];
}

bool rec_camera_nudged(const struct rec_camera *c, const double X0[3], const double X[3],
                       double uv[2], double J[14])
{
    struct rec_projection p;
    double Y[3], d[3], D[6]; /* d pixel / d X_c */
    if (!rec_camera_slopes(c, X, &p, D))
        return false;
    for (int a = 0; a < 3; a++)
        d[a] = X[a] - X0[a];
    rotate(c->R, d, Y); /* X_c - Y0 */
    for (int r = 0; r < 2; r++) {
        const double *g = D + 3 * r;
        double *j = J + 7 * r;
        j[0] = g[2] * Y[1] - g[1] * Y[2]; /* w x Y */
        j[1] = g[0] * Y[2] - g[2] * Y[0];
        j[2] = g[1] * Y[0] - g[0] * Y[1];
        memcpy(j + 3, g, 3 * sizeof *g);
    }
    J[6] = p.u - c->cx;
    J[13] = p.v - c->cy;
    if (uv != NULL) {
        uv[0] = p.u;
        uv[1] = p.v;
    }
    return true;
}

/* The rig in the moved world: X -> X0 + (1 + s) R(w) (X - X0) + t. */
static void move_world(struct rec_rig *rig, const double X0[3], const double v[7])
{
    double D[9], arm[3], Y[3], R[9], k = exp(v[6]);
    rec_rotation(v, D);
    rotate(D, X0, arm);
    for (int a = 0; a < 3; a++)
        arm[a] = X0[a] + v[3 + a] - k * arm[a]; /* T X = k D X + arm */
    for (size_t c = 0; c < rig->n_cameras; c++) {
        struct rec_camera *q = &rig->cameras[c];
        rotate(q->R, arm, Y);
        rec_mat3(q->R, D, R);
        memcpy(q->R, R, sizeof R);
        for (int a = 0; a < 3; a++)
            q->t[a] = (Y[a] + q->t[a]) / k;
    }
}

double rec_gauge_distance(const struct rec_rig *a, const struct rec_rig *b, double *px)
{
    double all = 0, n = 0;
    for (size_t c = 0; c < a->n_cameras; c++) {
        double own = 0, m = 0;
        for (int i = 0; i < POINTS; i++) {
            double X[3], u[2], v[2];
            gauge_point(&a->grid, i, X);
            if (!rec_camera_sees(&a->cameras[c], X, u) || !rec_camera_project(&b->cameras[c], X, v))
                continue;
            own += (u[0] - v[0]) * (u[0] - v[0]) + (u[1] - v[1]) * (u[1] - v[1]);
            m++;
        }
        if (px != NULL)
            px[c] = m > 0 ? sqrt(own / m) : 0;
        all += own;
        n += m;
    }
    return n > 0 ? sqrt(all / n) : 0;
}

double rec_gauge_hold(const struct rec_rig *old, struct rec_rig *rig, double *px)
{
    double X0[3];
    gauge_middle(&old->grid, X0);
    for (int round = 0; round < ROUNDS; round++) {
        double M[49] = {0}, b[7] = {0};
        for (size_t c = 0; c < old->n_cameras; c++)
            for (int i = 0; i < POINTS; i++) {
                double X[3], u[2], now[2], J[14], W[14];
                const double *R = rig->cameras[c].R;
                gauge_point(&old->grid, i, X);
                if (!rec_camera_sees(&old->cameras[c], X, u) ||
                    !rec_camera_nudged(&rig->cameras[c], X0, X, now, J))
                    continue;
                for (int r = 0; r < 2; r++) { /* from the camera's axes to the world's */
                    const double *j = J + 7 * r;
                    double *w = W + 7 * r;
                    for (int a = 0; a < 3; a++) {
                        w[a] = j[0] * R[a] + j[1] * R[3 + a] + j[2] * R[6 + a];
                        w[3 + a] = j[3] * R[a] + j[4] * R[3 + a] + j[5] * R[6 + a];
                    }
                    w[6] = 0;
                    for (int a = 0; a < 3; a++)
                        w[6] += w[3 + a] * (X[a] - X0[a]);
                }
                for (int r = 0; r < 2; r++)
                    for (int p = 0; p < 7; p++) {
                        b[p] += W[7 * r + p] * (u[r] - now[r]);
                        for (int q = 0; q < 7; q++)
                            M[7 * p + q] += W[7 * r + p] * W[7 * r + q];
                    }
            }
        double trace = 0;
        for (int p = 0; p < 7; p++)
            trace += M[8 * p];
        for (int p = 0; p < 7; p++) /* numbers without information stay 0 */
            M[8 * p] += 1e-9 * trace + 1e-30;
        if (rec_spd_solve(M, b, 7))
            move_world(rig, X0, b);
    }
    return rec_gauge_distance(old, rig, px);
}
