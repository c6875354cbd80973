/* The covariance of lenses and poses propagated to the volume.  An error d of all parameters moves the projection
 * of point p in camera c by  A_cp d_c - G_cp m,  m = (sum G^T G)^-1 sum G^T A d.  Here m is the rigid motion of
 * the world, with derivative G, that minimises the squares; its part is removed.  With z = (d_c, m), 15 + 6
 * numbers of covariance Z, and b = (A, -G): E|e|^2 = tr(Z B), B = sum b^T b, and var = 2 tr((Z B)^2). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/model.h"
#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

#define N1 (REC_LENS + 6) /* numbers of a camera */
#define N2 (N1 + 6)       /* the same and the motion */
#define PP REC_CALIB_POINTS

static double voxel(const struct rec_grid *g)
{
    return cbrt(rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2));
}

/* Rows b [2][N2] of the world point `at` in camera c; voxels: size of 1 px there, in voxels.  False: outside the
 * picture. */
static bool rows(const struct calib *k, const struct rec_grid *g, size_t c, const double at[3],
                 double b[2 * N2], double *voxels)
{
    double X[3], Z[3], uv[2], A[2 * N1], G[6], B[12], back[6];
    const struct rec_calib_camera *m = &k->in->camera[c];
    rec_pose_inverse(k->to_world, back);
    rec_pose_apply(back, at, X);
    const struct rec_model lens = rec_calib_model(k, c, k->lens[c]);
    if (!rec_model_see(&lens, k->fit_pose[c], X, Z, uv, A, G) || uv[0] < -0.5 || uv[1] < -0.5 ||
        uv[0] > m->width - 0.5 || uv[1] > m->height - 0.5)
        return false;
    rec_model_turn(X, G, B);
    for (int r = 0; r < 2; r++) {
        memcpy(b + N2 * r, A + N1 * r, N1 * sizeof *b);
        for (int i = 0; i < 6; i++)
            b[N2 * r + N1 + i] = -B[6 * r + i];
    }
    *voxels = Z[2] / sqrt(k->lens[c][REC_FX] * k->lens[c][REC_FY]) / voxel(g);
    return true;
}

struct carry {
    size_t N;   /* N1 * cameras */
    double *M;  /* [6][N]: m = M d */
    double *MC; /* [6][N]: its product with the covariance */
    double MCM[36];
};

static void expect_motion(const struct calib *k, const struct rec_grid *g, const double *cov,
                          struct carry *w)
{
    double GG[36] = {0}, X[3], b[2 * N2], voxels;
    memset(w->M, 0, 6 * w->N * sizeof *w->M);
    for (size_t c = 0; c < k->nc; c++)
        for (int i = 0; i < PP; i++) {
            rec_calib_volume_point(g, i, X);
            if (!rows(k, g, c, X, b, &voxels))
                continue;
            for (int r = 0; r < 2; r++)
                for (int p = 0; p < 6; p++) {
                    double G = -b[N2 * r + N1 + p];
                    for (int q = 0; q < 6; q++)
                        GG[6 * p + q] -= G * b[N2 * r + N1 + q];
                    for (int q = 0; q < N1; q++)
                        w->M[(size_t)p * w->N + c * N1 + (size_t)q] += G * b[N2 * r + q];
                }
        }
    rec_calib_invert6(GG);
    for (size_t j = 0; j < w->N; j++) {
        double t[6];
        for (int p = 0; p < 6; p++) {
            t[p] = 0;
            for (int q = 0; q < 6; q++)
                t[p] += GG[6 * p + q] * w->M[(size_t)q * w->N + j];
        }
        for (size_t p = 0; p < 6; p++)
            w->M[p * w->N + j] = t[p];
    }
    for (size_t p = 0; p < 6; p++)
        for (size_t j = 0; j < w->N; j++) {
            double sum = 0;
            for (size_t i = 0; i < w->N; i++)
                sum += w->M[p * w->N + i] * cov[i * w->N + j];
            w->MC[p * w->N + j] = sum;
        }
    for (size_t p = 0; p < 6; p++)
        for (size_t q = 0; q < 6; q++) {
            double sum = 0;
            for (size_t j = 0; j < w->N; j++)
                sum += w->MC[p * w->N + j] * w->M[q * w->N + j];
            w->MCM[6 * p + q] = sum;
        }
}

static void joint_cov(const double *cov, const struct carry *w, size_t c, double Z[N2][N2])
{
    for (size_t i = 0; i < N1; i++)
        for (size_t j = 0; j < N1; j++)
            Z[i][j] = cov[(c * N1 + i) * w->N + c * N1 + j];
    for (size_t p = 0; p < 6; p++) {
        for (size_t j = 0; j < N1; j++)
            Z[N1 + p][j] = Z[j][N1 + p] = w->MC[p * w->N + c * N1 + j];
        for (size_t q = 0; q < 6; q++)
            Z[N1 + p][N1 + q] = w->MCM[6 * p + q];
    }
}

/* rms and its 95 % quantile, of a sum of squares with mean tr(ZB) / n and variance 2 tr((ZB)^2) / n^2.  The sum is
 * taken for a chi^2 with matching degrees of freedom; the quantile is Wilson and Hilferty's. */
static void expect_spread(const double Z[N2][N2], const double B[N2][N2], double n, double *rms,
                          double *most)
{
    double P[N2][N2], mean = 0, var = 0;
    for (int i = 0; i < N2; i++)
        for (int j = 0; j < N2; j++) {
            P[i][j] = 0;
            for (int l = 0; l < N2; l++)
                P[i][j] += Z[i][l] * B[l][j];
        }
    for (int i = 0; i < N2; i++) {
        mean += P[i][i];
        for (int j = 0; j < N2; j++)
            var += 2 * P[i][j] * P[j][i];
    }
    *rms = sqrt(fmax(0, mean / n));
    double free = var > 0 ? 2 * mean * mean / var : 1, t = 2 / (9 * free);
    double q = 1 - t + 1.6448536269514722 * sqrt(t);
    *most = *rms * sqrt(q * q * q);
}

static double quadratic(const double Z[N2][N2], const double *b)
{
    double sum = 0;
    for (int i = 0; i < N2; i++)
        for (int j = 0; j < N2; j++)
            sum += b[i] * Z[i][j] * b[j];
    return sum;
}

/* One camera: its expected error, and its part of the error map of the volume. */
static size_t of_camera(const struct calib *k, const struct rec_grid *g, size_t c,
                        const double Z[N2][N2], double *map, double *seen,
                        struct rec_uncertainty *u)
{
    double B[2][N2][N2] = {{{0}}}, X[3], b[2 * N2], voxels;
    size_t n = 0;
    for (int i = 0; i < PP; i++) {
        rec_calib_volume_point(g, i, X);
        if (!rows(k, g, c, X, b, &voxels))
            continue;
        for (int r = 0; r < 2; r++) {
            const double *row = b + N2 * r;
            for (int p = 0; p < N2; p++)
                for (int q = 0; q < N2; q++) {
                    B[0][p][q] += row[p] * row[q];
                    B[1][p][q] += voxels * voxels * row[p] * row[q];
                }
            map[i] += quadratic(Z, row);
        }
        seen[i]++;
        n++;
    }
    if (n > 0) {
        expect_spread(Z, (const double(*)[N2])B[0], (double)n, &u->px, &u->px_95);
        expect_spread(Z, (const double(*)[N2])B[1], (double)n, &u->voxels, &u->voxels_95);
    }
    return n;
}

pvx_err rec_calib_expect(struct calib *k, const struct rec_rig *rig, double *cov,
                         struct rec_uncertainty *out)
{
    struct carry w = {.N = N1 * k->nc};
    struct rec_calib_report *r = k->out;
    double map[PP] = {0}, seen[PP] = {0}, Z[N2][N2], px = 0, voxels = 0;
    size_t cameras = 0;
    w.M = pvx_calloc(6 * w.N, sizeof *w.M);
    w.MC = pvx_calloc(6 * w.N, sizeof *w.MC);
    if (w.M == NULL || w.MC == NULL) {
        free(w.M);
        free(w.MC);
        return PVX_ENOMEM;
    }
    expect_motion(k, &rig->grid, cov, &w);
    for (size_t c = 0; c < k->nc; c++) {
        joint_cov(cov, &w, c, Z);
        out[c] = (struct rec_uncertainty){0};
        if (of_camera(k, &rig->grid, c, (const double(*)[N2])Z, map, seen, &out[c]) == 0 ||
            rec_calib_stays(k, c))
            continue;
        px += out[c].px * out[c].px;
        voxels += out[c].voxels * out[c].voxels;
        r->voxels_95 = fmax(r->voxels_95, out[c].voxels_95);
        cameras++;
    }
    for (int i = 0; i < PP; i++)
        r->at[i] = seen[i] > 0 ? sqrt(map[i] / seen[i]) : NAN;
    r->px = cameras > 0 ? sqrt(px / (double)cameras) : NAN;
    r->voxels = cameras > 0 ? sqrt(voxels / (double)cameras) : NAN;
    free(w.M);
    free(w.MC);
    return PVX_OK;
}
