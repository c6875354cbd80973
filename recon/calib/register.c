/* Registers two rigs of the same cameras by their views of the volume: the rigid motion that minimises the
 * distances between projections of its points.  In pixels, because a camera's turn and principal point, or its
 * centre and axis, can trade against each other without a visible change in any pixel. */
#include <math.h>
#include <string.h>

#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

void rec_calib_volume_point(const struct rec_grid *g, int i, double X[3])
{
    const int at[3] = {i % REC_CALIB_SIDE, i / REC_CALIB_SIDE % REC_CALIB_SIDE,
                       i / (REC_CALIB_SIDE * REC_CALIB_SIDE)};
    for (int a = 0; a < 3; a++)
        X[a] = g->min[a] + (at[a] + 0.5) / REC_CALIB_SIDE * (g->max[a] - g->min[a]);
}

/* Inverse of a symmetric 6x6 matrix by Gauss-Jordan; undetermined directions are left out. */
void rec_calib_invert6(double A[36])
{
    double V[36] = {0}, most = 0;
    bool used[6] = {false};
    for (int i = 0; i < 6; i++) {
        V[7 * i] = 1;
        most = fmax(most, A[7 * i]);
    }
    for (int step = 0; step < 6; step++) {
        int p = -1;
        for (int i = 0; i < 6; i++)
            if (!used[i] && (p < 0 || A[7 * i] > A[7 * p]))
                p = i;
        used[p] = true;
        if (!(A[7 * p] > 1e-12 * most)) {
            for (int j = 0; j < 6; j++)
                A[6 * p + j] = V[6 * p + j] = 0;
            continue;
        }
        double over = 1 / A[7 * p];
        for (int j = 0; j < 6; j++) {
            A[6 * p + j] *= over;
            V[6 * p + j] *= over;
        }
        for (int i = 0; i < 6; i++) {
            double f = A[6 * i + p];
            for (int j = 0; j < 6 && i != p; j++) {
                A[6 * i + j] -= f * A[6 * p + j];
                V[6 * i + j] -= f * V[6 * p + j];
            }
        }
    }
    memcpy(A, V, sizeof V);
}

struct sum {
    double A[36], v[6];                /* normal equations of the motion */
    double of[REC_MAX_CAMERAS], worst; /* sum of squares of each camera; px */
    double n[REC_MAX_CAMERAS];
};

/* One point in one camera of each rig, b's after the motion m. */
static void register_add(const struct rec_camera *a, const struct rec_camera *b, const double X[3],
                         const double m[6], double weight, size_t c, struct sum *s)
{
    double Y[3], ua[2];
    struct rec_projection p;
    rec_pose_apply(m, X, Y);
    if (!rec_camera_sees(a, X, ua) || !rec_camera_project_full(b, Y, &p))
        return;
    double e[2] = {ua[0] - p.u, ua[1] - p.v}, z = b->t[2];
    for (int j = 0; j < 3; j++)
        z += b->R[6 + j] * Y[j];
    for (int r = 0; r < 2; r++) {
        double W[3], g[6];
        for (int j = 0; j < 3; j++)
            W[j] = (p.J[2 * r] * (b->R[j] - p.x * b->R[6 + j]) +
                    p.J[2 * r + 1] * (b->R[3 + j] - p.y * b->R[6 + j])) /
                   z;
        for (int j = 0; j < 3; j++) { /* Y moves by turn x Y + shift */
            int q = (j + 1) % 3, t = (j + 2) % 3;
            g[j] = Y[q] * W[t] - Y[t] * W[q];
            g[3 + j] = W[j];
        }
        for (int q = 0; q < 6; q++) {
            s->v[q] += weight * g[q] * e[r];
            for (int t = 0; t < 6; t++)
                s->A[6 * q + t] += weight * g[q] * g[t];
        }
    }
    s->of[c] += e[0] * e[0] + e[1] * e[1];
    s->worst = fmax(s->worst, hypot(e[0], e[1]));
    s->n[c]++;
}

/* The start: centres, and points a little along each axis. */
static void register_start(const struct rec_rig *a, const struct rec_rig *b, double m[6],
                           double *scale)
{
    double pa[4 * REC_MAX_CAMERAS][3], pb[4 * REC_MAX_CAMERAS][3], weight[4 * REC_MAX_CAMERAS];
    for (size_t i = 0; i < 4 * a->n_cameras; i++) {
        const struct rec_camera *ca = &a->cameras[i / 4], *cb = &b->cameras[i / 4];
        rec_camera_centre(ca, pa[i]);
        rec_camera_centre(cb, pb[i]);
        for (size_t j = 0; j < 3 && i % 4 > 0; j++) {
            pa[i][j] += ca->R[3 * (i % 4 - 1) + j];
            pb[i][j] += cb->R[3 * (i % 4 - 1) + j];
        }
        weight[i] = i % 4 == 0 ? 1 : 0.1;
    }
    rec_pose_align((const double(*)[3])pa, (const double(*)[3])pb, weight, (int)(4 * a->n_cameras),
                   m, scale);
}

pvx_err rec_calib_register(const struct rec_rig *a, const struct rec_rig *b, bool robust,
                           double m[6], struct rec_calib_overlay *out)
{
    struct sum s;
    double weight[REC_MAX_CAMERAS], sorted[REC_MAX_CAMERAS], X[3], all = 0, n = 0;
    if (a->n_cameras != b->n_cameras || a->n_cameras > REC_MAX_CAMERAS || a->n_cameras == 0)
        return PVX_EINVAL;
    register_start(a, b, m, &out->scale);
    for (size_t c = 0; c < a->n_cameras; c++)
        weight[c] = 1;
    for (int round = 0; round < (robust ? 30 : 10); round++) { /* Gauss-Newton */
        memset(&s, 0, sizeof s);
        for (size_t c = 0; c < a->n_cameras; c++)
            for (int i = 0; i < REC_CALIB_POINTS; i++) {
                rec_calib_volume_point(&a->grid, i, X);
                register_add(&a->cameras[c], &b->cameras[c], X, m, weight[c], c, &s);
            }
        for (size_t c = 0; c < a->n_cameras; c++)
            sorted[c] = out->px[c] = s.n[c] > 0 ? sqrt(s.of[c] / s.n[c]) : 0;
        double unit = fmax(2 * pvx_median(sorted, a->n_cameras), 1e-3);
        for (size_t c = 0; c < a->n_cameras && robust; c++)
            weight[c] = 1 / pow(1 + out->px[c] * out->px[c] / (unit * unit), 2);
        rec_calib_invert6(s.A);
        double step[6] = {0}, next[6];
        for (int q = 0; q < 6; q++)
            for (int t = 0; t < 6; t++)
                step[q] += s.A[6 * q + t] * s.v[t];
        rec_pose_mul(step, m, next);
        memcpy(m, next, sizeof next);
    }
    for (size_t c = 0; c < a->n_cameras; c++) {
        all += s.of[c];
        n += s.n[c];
    }
    out->rms = n > 0 ? sqrt(all / n) : NAN;
    out->worst = s.worst;
    return n > 0 ? PVX_OK : PVX_EINVAL;
}

pvx_err rec_calib_distance(const struct rec_rig *a, const struct rec_rig *b, double *rms,
                           double *worst)
{
    struct rec_calib_overlay o;
    double m[6];
    PVX_TRY(rec_calib_register(a, b, false, m, &o));
    *rms = o.rms;
    *worst = o.worst;
    return PVX_OK;
}
