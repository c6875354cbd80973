/* Residuals of the present state; the other files judge by them. */
#include <math.h>
#include <stdlib.h>

#include "recon/calib/model.h"
#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

void rec_calib_point(const struct calib *k, const struct view *v, const struct seen *s, double X[3])
{
    double a = (s->x - k->middle[0]) / k->half[0], b = (s->y - k->middle[1]) / k->half[1];
    X[0] = s->x;
    X[1] = s->y;
    X[2] = k->shape[0] * (a * a - 1.0 / 3) + k->shape[1] * a * b + k->shape[2] * (b * b - 1.0 / 3) +
           (v->board->face == REC_BACK ? k->shape[3] : 0);
}

void rec_calib_measure(struct calib *k, const struct view *v, const double to_camera[6])
{
    const struct rec_model m = rec_calib_model(k, v->camera, k->lens[v->camera]);
    for (size_t i = v->first; i < v->first + v->n; i++) {
        struct seen *s = &k->seen[i];
        double X[3], Z[3], uv[2];
        rec_calib_point(k, v, s, X);
        rec_model_move(to_camera, X, Z, NULL, NULL);
        s->far = INFINITY;
        s->r[0] = s->r[1] = 0;
        if (!rec_model_project(&m, Z, uv, NULL, NULL))
            continue;
        s->r[0] = s->u - uv[0];
        s->r[1] = s->v - uv[1];
        s->far =
            hypot(s->W[0] * s->r[0], s->W[1] * s->r[0] + s->W[2] * s->r[1]) / k->scale[v->camera];
    }
}

void rec_calib_measure_all(struct calib *k)
{
    for (size_t i = 0; i < k->nv; i++) {
        double pose[6];
        const struct view *v = &k->view[i];
        if (!k->placed[v->frame] || !k->joined[v->camera] || v->n == 0)
            continue;
        rec_pose_mul(k->pose[v->camera], k->board[v->frame], pose);
        rec_calib_measure(k, v, pose);
    }
}

double rec_calib_rms(const struct calib *k, const struct view *v)
{
    double sum = 0;
    size_t n = 0;
    for (size_t i = v->first; i < v->first + v->n; i++)
        if (!k->seen[i].wrong) {
            const struct seen *s = &k->seen[i];
            sum += isfinite(s->far) ? s->r[0] * s->r[0] + s->r[1] * s->r[1] : 1e6;
            n++;
        }
    return n > 0 ? sqrt(sum / (double)n) : 0;
}

double rec_calib_usual(const struct calib *k, const struct view *v)
{
    double d[2048];
    size_t n = 0, step = v->n / 2048 + 1;
    for (size_t i = v->first; i < v->first + v->n; i += step) {
        const struct seen *s = &k->seen[i];
        d[n++] = isfinite(s->far) ? hypot(s->r[0], s->r[1]) : 1e3;
    }
    return pvx_median(d, n);
}

struct drift rec_calib_drift(const struct calib *k, const struct view *v, bool wrong_too)
{
    double mean[4] = {0}, rr = 0, grow = 0, turn = 0, n = 0;
    for (size_t i = v->first; i < v->first + v->n; i++) {
        const struct seen *s = &k->seen[i];
        if (!isfinite(s->far) || (s->wrong && !wrong_too))
            continue;
        const double x[4] = {s->u, s->v, s->r[0], s->r[1]};
        for (int j = 0; j < 4; j++)
            mean[j] += x[j];
        n++;
    }
    for (int j = 0; j < 4; j++)
        mean[j] /= fmax(n, 1);
    for (size_t i = v->first; i < v->first + v->n; i++) {
        const struct seen *s = &k->seen[i];
        double x = s->u - mean[0], y = s->v - mean[1];
        if (!isfinite(s->far) || (s->wrong && !wrong_too))
            continue;
        rr += x * x + y * y;
        grow += x * s->r[0] + y * s->r[1];
        turn += x * s->r[1] - y * s->r[0];
    }
    double rim = sqrt(rr / fmax(n, 1)), over = rr > 0 ? rim / rr : 0;
    return (struct drift){
        {mean[2], mean[3], grow * over, turn * over}, fmax(n, 1), k->out->frame[v->frame]};
}

#define NX 16
#define NY 12

/* The mean residual of one view in every cell; n: corners. */
static void residual_cells(const struct calib *k, const struct view *v, double (*mean)[2],
                           double *n)
{
    const struct rec_calib_camera *m = &k->in->camera[v->camera];
    for (int i = 0; i < NX * NY; i++)
        mean[i][0] = mean[i][1] = n[i] = 0;
    for (size_t j = v->first; j < v->first + v->n; j++) {
        const struct seen *s = &k->seen[j];
        int x = (int)fmin(fmax(NX * (s->u + 0.5) / m->width, 0), NX - 1);
        int y = (int)fmin(fmax(NY * (s->v + 0.5) / m->height, 0), NY - 1);
        if (s->wrong || !isfinite(s->far))
            continue;
        mean[NX * y + x][0] += s->r[0];
        mean[NX * y + x][1] += s->r[1];
        n[NX * y + x]++;
    }
    for (int i = 0; i < NX * NY; i++)
        for (int a = 0; a < 2 && n[i] > 0; a++)
            mean[i][a] /= n[i];
}

/* A view is one sample of a cell, since its corners may err together.  |mean|^2 over the views is the repeating
 * part plus the variance divided by their number. */
double rec_calib_structure(const struct calib *k, uint32_t c, double *coverage)
{
    double sum[NX * NY][2] = {{0}}, square[NX * NY] = {0}, views[NX * NY] = {0}, mean[NX * NY][2];
    double n[NX * NY], repeats = 0, all = 0, seen = 0;
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        if (v->camera != c || v->fate != REC_VIEW_USED)
            continue;
        residual_cells(k, v, mean, n);
        for (int j = 0; j < NX * NY; j++)
            if (n[j] > 0) {
                views[j]++;
                for (int a = 0; a < 2; a++) {
                    sum[j][a] += mean[j][a];
                    square[j] += mean[j][a] * mean[j][a];
                }
            }
    }
    for (int j = 0; j < NX * NY; j++) {
        seen += views[j] > 0;
        if (views[j] < 3)
            continue;
        double m2 = (sum[j][0] * sum[j][0] + sum[j][1] * sum[j][1]) / (views[j] * views[j]);
        double variance = (square[j] - views[j] * m2) / (views[j] - 1);
        repeats += views[j] * (m2 - variance / views[j]);
        all += views[j];
    }
    *coverage = seen / (NX * NY);
    return all > 0 ? sqrt(fmax(0, repeats / all)) : 0;
}
