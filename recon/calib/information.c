#include "recon/calib/information.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/model.h"
#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

#define N1     REC_OF_CAMERA
#define ENOUGH 16 /* corners of a view that are evaluated; they stand for the others */

/* ---- one frame ---- */

void rec_information_begin(struct rec_information *w, const double board[12])
{
    memcpy(w->board, board, sizeof w->board);
    memset(w->V, 0, sizeof w->V);
    w->n_seen = 0;
}

/* A [2][N1]: d pixel / d lens, pose; B [2][6]: d pixel / d (turn, shift) of the board about its origin. */
static bool derive(const struct rec_information *w, uint32_t c, const double X[3], double A[2 * N1],
                   double B[12], double *depth)
{
    double Z[3], uv[2], G[6], Y[3];
    struct rec_glass window[REC_WINDOWS];
    const struct rec_model m = {w->lens[c], window, rec_calib_windows(&w->rig->cameras[c], window)};
    if (!rec_model_see(&m, w->pose[c], X, Z, uv, A, G))
        return false;
    for (int i = 0; i < 3; i++)
        Y[i] = X[i] - w->board[9 + i];
    rec_model_turn(Y, G, B);
    *depth = Z[2];
    return true;
}

void rec_information_view(struct rec_information *w, const struct rec_board_view *v)
{
    double *U = w->U[w->n_seen], *W = w->W[w->n_seen], A[2 * N1], B[12], b[3], X[3], depth;
    size_t step = (v->n + ENOUGH - 1) / ENOUGH, used = (v->n + step - 1) / step;
    double s = w->weight[v->camera] * (double)v->n / (double)used;
    memset(U, 0, sizeof *w->U);
    memset(W, 0, sizeof *w->W);
    for (size_t i = 0; i < v->n; i += step) {
        rec_board_point(&w->in->board, v->face, v->corner[i].id, b);
        for (int a = 0; a < 3; a++)
            X[a] = w->board[3 * a] * b[0] + w->board[3 * a + 1] * b[1] +
                   w->board[3 * a + 2] * b[2] + w->board[9 + a];
        if (!derive(w, v->camera, X, A, B, &depth))
            continue;
        for (int r = 0; r < 2; r++) {
            const double *a = A + N1 * r, *d = B + 6 * r;
            for (int p = 0; p < N1; p++) {
                for (int q = 0; q < N1; q++)
                    U[N1 * p + q] += s * a[p] * a[q];
                for (int q = 0; q < 6; q++)
                    W[6 * p + q] += s * a[p] * d[q];
            }
            for (int p = 0; p < 6; p++)
                for (int q = 0; q < 6; q++)
                    w->V[6 * p + q] += s * d[p] * d[q];
        }
    }
    w->seen[w->n_seen++] = v->camera;
}

/* The frame's term of (1) into out [n][n], n = N1 * n_seen, in the order in which the cameras were added. */
static void term(const struct rec_information *w, double *out)
{
    size_t n = (size_t)N1 * w->n_seen;
    double V[36], WV[N1 * 6];
    memcpy(V, w->V, sizeof V);
    rec_calib_invert6(V);
    for (size_t a = 0; a < w->n_seen; a++) {
        for (int p = 0; p < N1; p++)
            for (int q = 0; q < 6; q++) {
                WV[6 * p + q] = 0;
                for (int i = 0; i < 6; i++)
                    WV[6 * p + q] += w->W[a][6 * p + i] * V[6 * i + q];
            }
        for (size_t b = 0; b < w->n_seen; b++)
            for (size_t p = 0; p < N1; p++)
                for (size_t q = 0; q < N1; q++) {
                    double sum = a == b ? w->U[a][N1 * p + q] : 0;
                    for (size_t i = 0; i < 6; i++)
                        sum -= WV[6 * p + i] * w->W[b][6 * q + i];
                    out[(a * N1 + p) * n + b * N1 + q] = sum;
                }
    }
}

/* ---- small linear algebra ---- */

/* Replaces A [n][n], symmetric and positive definite, by its inverse (Cholesky).  False: it is not positive
 * definite. */
static bool invert(double *A, size_t n)
{
    for (size_t j = 0; j < n; j++) { /* A = L L^T, L below */
        double d = A[j * n + j];
        for (size_t k = 0; k < j; k++)
            d -= A[j * n + k] * A[j * n + k];
        if (!(d > 1e-14 * fabs(A[j * n + j])) || !isfinite(d))
            return false;
        A[j * n + j] = sqrt(d);
        for (size_t i = j + 1; i < n; i++) {
            double s = A[i * n + j];
            for (size_t k = 0; k < j; k++)
                s -= A[i * n + k] * A[j * n + k];
            A[i * n + j] = s / A[j * n + j];
        }
    }
    for (size_t j = 0; j < n; j++) { /* L^-1 below */
        A[j * n + j] = 1 / A[j * n + j];
        for (size_t i = j + 1; i < n; i++) {
            double s = 0;
            for (size_t k = j; k < i; k++)
                s -= A[i * n + k] * A[k * n + j];
            A[i * n + j] = s / A[i * n + i];
        }
    }
    for (size_t i = 0; i < n; i++) /* L^-T L^-1, above and on the diagonal */
        for (size_t j = i; j < n; j++) {
            double s = 0;
            for (size_t k = j; k < n; k++)
                s += A[k * n + i] * A[k * n + j];
            A[i * n + j] = s;
        }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++)
            A[i * n + j] = A[j * n + i];
    return true;
}

/* tr(A^-1 B), [n][n] both, by elimination with pivots; both are overwritten.  NAN: A is singular. */
static double trace_solve(double *A, double *B, size_t n)
{
    double tr = 0;
    for (size_t j = 0; j < n; j++) {
        size_t best = j;
        for (size_t i = j + 1; i < n; i++)
            if (fabs(A[i * n + j]) > fabs(A[best * n + j]))
                best = i;
        if (!(fabs(A[best * n + j]) > 1e-300))
            return NAN;
        for (size_t k = 0; best != j && k < n; k++) {
            double t = A[j * n + k], u = B[j * n + k];
            A[j * n + k] = A[best * n + k];
            A[best * n + k] = t;
            B[j * n + k] = B[best * n + k];
            B[best * n + k] = u;
        }
        for (size_t i = j + 1; i < n; i++) {
            double f = A[i * n + j] / A[j * n + j];
            for (size_t k = j + 1; f != 0 && k < n; k++)
                A[i * n + k] -= f * A[j * n + k];
            for (size_t k = 0; f != 0 && k < n; k++)
                B[i * n + k] -= f * B[j * n + k];
        }
    }
    for (size_t i = n; i-- > 0;) /* upwards; of row i only columns up to i are needed */
        for (size_t k = 0; k <= i; k++) {
            double s = B[i * n + k];
            for (size_t j = i + 1; j < n; j++)
                s -= A[i * n + j] * B[j * n + k];
            B[i * n + k] = s / A[i * n + i];
            tr += k == i ? B[i * n + k] : 0;
        }
    return tr;
}

/* ---- all that was seen ---- */

/* 1 / usual variance of a corner in camera c. */
static double weight_of(const struct rec_calib_input *in, const struct rec_calib_report *r,
                        uint32_t c, double *room)
{
    size_t n = 0;
    for (size_t i = 0; i < in->n_views; i++) {
        const struct rec_board_view *v = &in->view[i];
        if (v->camera != c || r->view[i].fate != REC_VIEW_USED || v->n == 0)
            continue;
        double sum = 0;
        for (size_t s = 0; s < v->n; s++)
            sum += 0.5 * (v->corner[s].cov[0] + v->corner[s].cov[2]);
        room[n++] = sum / (double)v->n;
    }
    if (n == 0)
        return 0;
    qsort(room, n, sizeof *room, pvx_ascending);
    return 1 / (fmax(r->chi2, 1e-6) * fmax(room[n / 2], 1e-12));
}

static void add_frames(struct rec_information *w, const struct rec_calib_report *r, double *L)
{
    for (size_t f = 0; f < r->n_frames; f++) {
        if (isnan(r->board[f][0]))
            continue;
        rec_information_begin(w, r->board[f]);
        for (size_t i = 0; i < w->in->n_views; i++)
            if (w->in->view[i].frame == r->frame[f] && r->view[i].fate == REC_VIEW_USED)
                rec_information_view(w, &w->in->view[i]);
        size_t n = (size_t)N1 * w->n_seen;
        term(w, w->D);
        for (size_t i = 0; i < n; i++)
            for (size_t j = 0; j < n; j++)
                L[(w->seen[i / N1] * N1 + i % N1) * w->N + w->seen[j / N1] * N1 + j % N1] +=
                    w->D[i * n + j];
    }
}

/* Priors as in adjust.c. */
static void add_beliefs(const struct rec_information *w, double *L)
{
    for (uint32_t c = 0; c < w->nc; c++) {
        struct calib k = {.in = w->in};
        double s[REC_LENS], f = w->lens[c][REC_FX], over = 1 / (0.01 * f);
        k.believed[c][REC_FX] = f;
        rec_calib_beliefs(&k, c, s);
        double *at = L + (size_t)c * N1 * (w->N + 1);
        bool held = (w->in->camera[c].hold & REC_HOLD_LENS) != 0;
        for (size_t i = 0; i < REC_LENS; i++)
            at[i * (w->N + 1)] += held ? 1e12 : 1 / (s[i] * s[i]);
        at[0] += over * over;
        at[w->N + 1] += over * over;
        at[1] -= over * over;
        at[w->N] -= over * over;
    }
}

/* H of the points of the volume, into out [N][N]. */
static pvx_err error_form(struct rec_information *w, double *out)
{
    size_t N = w->N;
    double GG[36] = {0}, Q[36] = {0}, side = 1;
    double *mem = pvx_calloc(3 * 6 * N + 6, sizeof *mem);
    if (mem == NULL)
        return PVX_ENOMEM;
    double *M = mem, *F = mem + 6 * N, *P = mem + 12 * N; /* M, P [6][N]; F [N][6] */
    for (int a = 0; a < 3; a++)
        side *= rec_grid_h(&w->rig->grid, a);
    memset(w->board, 0, sizeof w->board); /* derive: motions about the world's origin */
    for (uint32_t c = 0; c < w->nc; c++) {
        const struct rec_camera *k = &w->rig->cameras[c];
        double X[3], A[2 * N1], G[12], uv[2], depth, n = 0;
        for (int i = 0; i < REC_CALIB_POINTS; i++) {
            rec_calib_volume_point(&w->rig->grid, i, X);
            n += rec_camera_sees(k, X, uv);
        }
        for (int i = 0; i < REC_CALIB_POINTS && n > 0; i++) {
            rec_calib_volume_point(&w->rig->grid, i, X);
            if (!rec_camera_sees(k, X, uv) || !derive(w, c, X, A, G, &depth))
                continue;
            double voxel = depth / sqrt(k->fx * k->fy) / cbrt(side);
            double o = voxel * voxel / (n * w->nc);
            for (int r = 0; r < 2; r++) {
                const double *a = A + N1 * r, *g = G + 6 * r;
                for (size_t p = 0; p < 6; p++)
                    for (size_t q = 0; q < 6; q++) {
                        GG[6 * p + q] += g[p] * g[q];
                        Q[6 * p + q] += o * g[p] * g[q];
                    }
                for (size_t p = 0; p < N1; p++) {
                    for (size_t q = 0; q < 6; q++) {
                        M[q * N + c * N1 + p] += g[q] * a[p];
                        F[6 * (c * N1 + p) + q] += o * a[p] * g[q];
                    }
                    for (size_t q = 0; q < N1; q++)
                        out[(c * N1 + p) * N + c * N1 + q] += o * a[p] * a[q];
                }
            }
        }
    }
    rec_calib_invert6(GG);
    for (size_t j = 0; j < N; j++) {
        double t[6];
        for (size_t p = 0; p < 6; p++) {
            t[p] = 0;
            for (size_t q = 0; q < 6; q++)
                t[p] += GG[6 * p + q] * M[q * N + j];
        }
        for (size_t p = 0; p < 6; p++)
            M[p * N + j] = t[p];
    }
    for (size_t p = 0; p < 6; p++)
        for (size_t j = 0; j < N; j++)
            for (size_t q = 0; q < 6; q++)
                P[p * N + j] += Q[6 * p + q] * M[q * N + j];
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < N; j++)
            for (size_t p = 0; p < 6; p++)
                out[i * N + j] += M[p * N + i] * P[p * N + j] - F[6 * i + p] * M[p * N + j] -
                                  M[p * N + i] * F[6 * j + p];
    free(mem);
    return PVX_OK;
}

/* Treats the pose of the camera that defines the world as known: its rows and columns are 0, the diagonal is
 * `value`. */
static void hold_world(const struct rec_information *w, uint32_t root, double value, double *A)
{
    for (size_t i = root * N1 + REC_LENS; i < root * N1 + N1; i++) {
        for (size_t j = 0; j < w->N; j++)
            A[i * w->N + j] = A[j * w->N + i] = 0;
        A[i * w->N + i] = value;
    }
}

static void information_multiply(const double *A, const double *B, size_t n, double *out)
{
    memset(out, 0, n * n * sizeof *out);
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < n; k++)
            for (size_t j = 0; j < n; j++)
                out[i * n + j] += A[i * n + k] * B[k * n + j];
}

static pvx_err information_allocate(struct rec_information *w)
{
    w->lens = pvx_calloc(w->nc, sizeof *w->lens);
    w->pose = pvx_calloc(w->nc, sizeof *w->pose);
    w->weight = pvx_calloc(w->nc, sizeof *w->weight);
    w->U = pvx_calloc(w->nc, sizeof *w->U);
    w->W = pvx_calloc(w->nc, sizeof *w->W);
    w->C = pvx_calloc(w->N * w->N, sizeof *w->C);
    w->T = pvx_calloc(w->N * w->N, sizeof *w->T);
    w->D = pvx_calloc(w->N * w->N, sizeof *w->D);
    w->M = pvx_calloc(2 * w->N * w->N, sizeof *w->M);
    return w->lens == NULL || w->pose == NULL || w->weight == NULL || w->U == NULL ||
                   w->W == NULL || w->C == NULL || w->T == NULL || w->D == NULL || w->M == NULL
               ? PVX_ENOMEM
               : PVX_OK;
}

pvx_err rec_information_init(struct rec_information *w, const struct rec_calib_input *in,
                             const struct rec_rig *rig, const struct rec_calib_report *r)
{
    uint32_t root = 0;
    *w = (struct rec_information){
        .in = in, .rig = rig, .nc = (uint32_t)rig->n_cameras, .N = (size_t)N1 * rig->n_cameras};
    if (rig->n_cameras == 0 || rig->n_cameras != in->n_cameras || r->n_cameras != in->n_cameras)
        return PVX_EINVAL;
    PVX_TRY(information_allocate(w));
    double *room = pvx_calloc(in->n_views + 1, sizeof *room);
    if (room == NULL)
        return PVX_ENOMEM;
    for (uint32_t c = 0; c < w->nc; c++) {
        const struct rec_camera *k = &rig->cameras[c];
        const double lens[4] = {k->fx, k->fy, k->cx, k->cy};
        memcpy(w->lens[c], lens, sizeof lens);
        memcpy(w->lens[c] + REC_K1, k->dist, 5 * sizeof *k->dist);
        rec_rotation_log(k->R, w->pose[c]);
        memcpy(w->pose[c] + 3, k->t, sizeof k->t);
        w->weight[c] = weight_of(in, r, c, room);
        root = r->camera[c].used > r->camera[root].used ? c : root;
    }
    free(room);
    add_frames(w, r, w->C);
    add_beliefs(w, w->C);
    hold_world(w, root, 1, w->C);
    if (!invert(w->C, w->N))
        return PVX_ENOENT;
    hold_world(w, root, 0, w->C);
    memset(w->D, 0, w->N * w->N * sizeof *w->D);
    PVX_TRY(error_form(w, w->D)); /* H */
    information_multiply(w->C, w->D, w->N, w->M);
    for (size_t i = 0; i < w->N; i++)
        w->error += w->M[i * (w->N + 1)];
    information_multiply(w->M, w->C, w->N, w->T);
    return w->error > 0 && isfinite(w->error) ? PVX_OK : PVX_ENOENT;
}

double rec_information_gain(struct rec_information *w)
{
    size_t n = (size_t)N1 * w->n_seen, N = w->N;
    double *A = w->M, *B = w->M + n * n;
    term(w, w->D);
    memset(A, 0, 2 * n * n * sizeof *A);
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < n; k++) {
            double d = w->D[i * n + k];
            const double *C = w->C + (w->seen[k / N1] * N1 + k % N1) * N,
                         *T = w->T + (w->seen[k / N1] * N1 + k % N1) * N;
            for (size_t b = 0; b < w->n_seen; b++)
                for (size_t q = 0; q < N1; q++) {
                    A[i * n + b * N1 + q] += d * C[w->seen[b] * N1 + q];
                    B[i * n + b * N1 + q] += d * T[w->seen[b] * N1 + q];
                }
        }
        A[i * n + i] += 1;
    }
    double gain = trace_solve(A, B, n);
    return gain > 0 && gain < w->error ? gain : 0;
}

void rec_information_fini(struct rec_information *w)
{
    free(w->lens);
    free(w->pose);
    free(w->weight);
    free(w->U);
    free(w->W);
    free(w->C);
    free(w->T);
    free(w->D);
    free(w->M);
    *w = (struct rec_information){0};
}
