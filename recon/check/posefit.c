#include "recon/check/posefit.h"
#include "recon/geom/spd.h"

#include <math.h>
#include <string.h>

#define RHO   2e-3 /* weight of the prior; NUMERICS.md */
#define REACH 0.3  /* share of the box: how far a flame reaches from its middle */

enum { N = 7 };

static void posefit_middle_of(const struct rec_grid *g, double X0[3], double *size)
{
    double s = 0;
    for (int a = 0; a < 3; a++) {
        X0[a] = 0.5 * (g->min[a] + g->max[a]);
        s = fmax(s, g->max[a] - g->min[a]);
    }
    *size = s;
}

/* Standard deviations of the prior (posefit.h): REC_POSE_PX at the flame, or a tenth of that. */
static bool beliefs(const struct rec_camera *c, const double X0[3], double size, double sigma[N])
{
    double J[2 * N], reach = REACH * size;
    if (!rec_camera_nudged(c, X0, X0, NULL, J))
        return false;
    double per_m = hypot(J[3], J[10]), m = REC_POSE_PX / per_m;
    double depth = c->R[6] * X0[0] + c->R[7] * X0[1] + c->R[8] * X0[2] + c->t[2];
    sigma[0] = sigma[1] = 0.1 * m / reach;
    sigma[2] = m / reach;
    sigma[3] = sigma[4] = m;
    sigma[5] = m * depth / reach;
    sigma[6] = 0.1 * m / reach;
    return per_m > 0;
}

/* Normal equations of the windows; returns their tr(A). */
static double posefit_gather(const struct rec_lattice *l, const struct rec_camera *c,
                             const double X0[3], int32_t binning, double M[N * N], double b[N])
{
    double trace = 0, J[2 * N];
    for (int i = 0; i < REC_LATTICE; i++) {
        const struct rec_window *w = &l->w[i];
        double X[3];
        for (int a = 0; a < 3 && w->x > 0; a++)
            X[a] = w->X[a] / w->x;
        if (!(w->x > 0) || !rec_camera_nudged(c, X0, X, NULL, J))
            continue;
        for (int p = 0; p < N; p++) {
            double x = J[p] / binning, y = J[N + p] / binning;
            double ax = w->A[0] * x + w->A[1] * y, ay = w->A[1] * x + w->A[2] * y;
            b[p] += x * w->v[0] + y * w->v[1];
            for (int q = 0; q < N; q++)
                M[N * p + q] += (ax * J[q] + ay * J[N + q]) / binning;
        }
        trace += w->A[0] + w->A[2];
    }
    return trace;
}

static bool posefit_solve(const double M[N * N], const double b[N], unsigned held, double x[N])
{
    double K[N * N];
    for (int p = 0; p < N; p++) {
        bool off = (held >> p & 1) != 0;
        x[p] = off ? 0 : b[p];
        for (int q = 0; q < N; q++)
            K[N * p + q] = !off && (held >> q & 1) == 0 ? M[N * p + q] : p == q;
    }
    if (rec_spd_solve(K, x, N))
        return true;
    memset(x, 0, N * sizeof *x);
    return false;
}

/* Whether the flame determines the focal length better than the prior. */
static bool shows_focal(const double M[N * N], unsigned held, double belief)
{
    double e[N] = {0}, y[N];
    e[N - 1] = 1;
    return posefit_solve(M, e, held, y) && y[N - 1] * belief < 0.5;
}

bool rec_pose_fit(const struct rec_lattice *l, const struct rec_camera *c, const struct rec_grid *g,
                  int32_t binning, unsigned held, struct rec_pose_fit *out)
{
    double X0[3], size, sigma[N], M[N * N] = {0}, b[N] = {0}, J[2 * N];
    *out = (struct rec_pose_fit){.held = held};
    posefit_middle_of(g, X0, &size);
    if (!beliefs(c, X0, size, sigma))
        return false;
    double trace = posefit_gather(l, c, X0, binning, M, b);
    if (!(trace > 0))
        return false;
    double most = REC_POSE_PX / binning, weight = RHO * trace * most * most;
    for (int p = 0; p < N; p++)
        M[(N + 1) * p] += weight / (sigma[p] * sigma[p]);
    if ((held & REC_POSE_FOCAL) == 0 && !shows_focal(M, held, weight / (sigma[6] * sigma[6])))
        out->held |= REC_POSE_FOCAL;
    if (!posefit_solve(M, b, out->held, out->x))
        return false;
    double depth = c->R[6] * X0[0] + c->R[7] * X0[1] + c->R[8] * X0[2] + c->t[2];
    (void)rec_camera_nudged(c, X0, X0, NULL, J);
    for (int r = 0; r < 2; r++)
        for (int p = 0; p < N; p++)
            out->px[r] += J[N * r + p] * out->x[p];
    out->roll = out->x[2];
    out->size = out->x[6] - out->x[5] / depth;
    return true;
}

void rec_pose_apply_fit(struct rec_camera *c, const struct rec_grid *g,
                        const struct rec_pose_fit *f)
{
    double X0[3], size;
    posefit_middle_of(g, X0, &size);
    rec_camera_nudge(c, X0, f->x, f->x + 3);
    c->fx *= exp(f->x[6]);
    c->fy *= exp(f->x[6]);
}
