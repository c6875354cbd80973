/* gain.c - compares cameras: light of an even source or of a flame, gains. */
#include <stdlib.h>
#include <string.h>

#include "recon/light/parts.h"

void rec_light_middle(const struct rec_light_picture *p, double out[3])
{
    double sum[3] = {0}, count[3] = {0};
    size_t w = (size_t)p->width, h = (size_t)p->height;
    for (size_t i = 0; i < rec_light_pixels(p); i++)
        for (int k = 0; k < p->channels; k++) {
            size_t x = i % w, y = i / w;
            float v = p->mean[i * (size_t)p->channels + (size_t)k];
            if (x < w / 4 || x >= w - w / 4 || y < h / 4 || y >= h - h / 4 || !isfinite(v))
                continue;
            int c = rec_light_colour(p, i, k);
            sum[c] += (double)v;
            count[c]++;
        }
    bool grey = p->channels == 1 && p->cell == NULL;
    for (int c = 0; c < 3; c++) {
        int of = grey ? 0 : c;
        out[c] = count[of] > 0 ? sum[of] / count[of] : 0;
    }
}

static double gain_det3(const double A[9])
{
    return A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) +
           A[2] * (A[3] * A[7] - A[4] * A[6]);
}

/* ---- a flame ---- */

/* Brightness of a pixel: sum of its channels. */
static double gain_light_at(const struct rec_light_picture *p, size_t pixel)
{
    double s = 0;
    for (int k = 0; k < p->channels; k++) {
        float v = p->mean[pixel * (size_t)p->channels + (size_t)k];
        s += isfinite(v) ? (double)v : 0;
    }
    return s;
}

pvx_err rec_light_flux(const struct rec_light_picture *p, const struct rec_camera *c,
                       const double at[3], double out[3], struct pvx_diag *d)
{
    double centre[3], D2 = 0, edge = 0, all = 0, axis[3] = {c->R[6], c->R[7], c->R[8]};
    size_t w = (size_t)p->width, h = (size_t)p->height;
    double count[3] = {0}, sum[3] = {0};
    if (c->model >= REC_TELECENTRIC)
        return pvx_fail(d, PVX_EUNSUP, "model: %s is not supported here",
                        rec_camera_model_name(c->model));
    rec_camera_centre(c, centre);
    for (int a = 0; a < 3; a++)
        D2 += (at[a] - centre[a]) * (at[a] - centre[a]);
    for (size_t i = 0; i < w * h; i++) {
        double o[3], r[3], l = gain_light_at(p, i);
        size_t x = i % w, y = i / w;
        if (!rec_camera_ray(c, (double)x, (double)y, o, r))
            continue;
        double cosine = r[0] * axis[0] + r[1] * axis[1] + r[2] * axis[2];
        struct rec_projection lens;
        double X[3] = {o[0] + r[0], o[1] + r[1], o[2] + r[2]}, weight = cosine * cosine * cosine;
        if (rec_camera_project_full(c, X, &lens))
            weight *= c->fx * c->fy / (lens.J[0] * lens.J[3] - lens.J[1] * lens.J[2]);
        all += l;
        if (x < w / 50 + 1 || y < h / 50 + 1 || x >= w - w / 50 - 1 || y >= h - h / 50 - 1)
            edge += l;
        for (int k = 0; k < p->channels; k++) {
            float v = p->mean[i * (size_t)p->channels + (size_t)k];
            int col = rec_light_colour(p, i, k);
            count[col]++;
            sum[col] += isfinite(v) ? weight * (double)v : 0;
        }
    }
    if (!(all > 0))
        return pvx_fail(d, PVX_EINVAL, "there is no flame in its pictures");
    if (edge > 0.02 * all)
        return pvx_fail(
            d, PVX_ERANGE,
            "%.0f %% of its light is at the picture's border: a flame that is cut off, or a "
            "pedestal (pyrovox calibrate dark)",
            100 * edge / all);
    bool grey = p->channels == 1 && p->cell == NULL;
    for (int k = 0; k < 3; k++) { /* each pixel of a Bayer filter's colour stands for several */
        int of = grey ? 0 : k;
        out[k] = sum[of] / fmax(count[of], 1) * (double)(w * h) * D2 / (c->fx * c->fy);
    }
    return PVX_OK;
}

pvx_err rec_light_where(const struct rec_light_picture *const *p, const struct rec_camera *c,
                        size_t n, double at[3], struct pvx_diag *d)
{
    double A[9] = {0}, b[3] = {0};
    for (size_t q = 0; q < n; q++) {
        double all = 0, u = 0, v = 0, o[3], r[3];
        size_t w = (size_t)p[q]->width;
        for (size_t i = 0; i < rec_light_pixels(p[q]); i++) {
            double l = gain_light_at(p[q], i);
            all += l;
            u += l * (double)(i % w);
            v += l * (double)(i / w);
        }
        if (!(all > 0) || !rec_camera_ray(&c[q], u / all, v / all, o, r))
            continue;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                double m = (i == j) - r[i] * r[j];
                A[3 * i + j] += m;
                b[i] += m * o[j];
            }
    }
    double trace = A[0] + A[4] + A[8];
    if (!(gain_det3(A) > 1e-6 * trace * trace * trace) || !rec_spd_solve(A, b, 3))
        return pvx_fail(d, PVX_EINVAL, "the flame is seen from one side only");
    memcpy(at, b, sizeof b);
    return PVX_OK;
}

/* ---- gains ---- */

void rec_light_gains(const double *light, size_t n, double *gain)
{
    double sum = 0, count = 0;
    for (size_t i = 0; i < n; i++)
        if (light[i] > 0) {
            sum += log(light[i]);
            count++;
        }
    for (size_t i = 0; i < n; i++)
        gain[i] = light[i] > 0 ? exp(sum / count) / light[i] : 1;
}
