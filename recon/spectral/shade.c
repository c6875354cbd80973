#include "recon/spectral/shade.h"

#include <math.h>
#include <string.h>

void rec_shade_kappa(const struct rec_spectral *s, const struct rec_soot_params *p, double k[3])
{
    for (int q = 0; q < 3; q++) {
        double slope, i = rec_planck_channel(s, q, 1800, rec_soot_kappa, p, &slope);
        k[q] = rec_soot_kappa(p, REC_PLANCK_C2 / (-slope / i));
    }
}

void rec_shade_init(struct rec_shade *s, const struct rec_rig *rig, const struct rec_grid *grid,
                    const double k[3])
{
    *s = (struct rec_shade){.grid = *grid, .n = rig->n_cameras};
    memcpy(s->k, k, sizeof s->k);
    for (size_t c = 0; c < rig->n_cameras; c++) {
        const struct rec_camera *m = &rig->cameras[c];
        s->eye[c].from_far = m->model == REC_TELECENTRIC;
        if (s->eye[c].from_far)
            for (int a = 0; a < 3; a++)
                s->eye[c].at[a] = -m->R[6 + a];
        else
            rec_camera_centre(m, s->eye[c].at);
    }
}

/* f at a place in voxels, the first centre at 0. */
static double shade_f(const struct rec_grid *g, const float *f, const double u[3])
{
    int32_t i[3];
    double t[3], sum = 0;
    for (int a = 0; a < 3; a++) {
        double low = floor(u[a]);
        i[a] = (int32_t)low;
        t[a] = u[a] - low;
    }
    for (int c = 0; c < 8; c++) {
        int32_t x = i[0] + (c & 1), y = i[1] + (c >> 1 & 1), z = i[2] + (c >> 2);
        if (x < 0 || y < 0 || z < 0 || x >= g->n[0] || y >= g->n[1] || z >= g->n[2])
            continue;
        double v =
            (double)f[((size_t)z * (size_t)g->n[1] + (size_t)y) * (size_t)g->n[0] + (size_t)x];
        if (v > 0)
            sum += v * (c & 1 ? t[0] : 1 - t[0]) * (c & 2 ? t[1] : 1 - t[1]) *
                   (c & 4 ? t[2] : 1 - t[2]);
    }
    return sum;
}

/* Length [m] of the ray from voxel u, along d (unit, world), to the box's border; in[3]: d in voxels per metre. */
static double shade_way(const struct rec_grid *g, const double u[3], const double d[3],
                        double in[3])
{
    double way = INFINITY;
    for (int a = 0; a < 3; a++) {
        in[a] = d[a] * g->n[a] / (g->max[a] - g->min[a]);
        if (in[a] > 0)
            way = fmin(way, (g->n[a] - 0.5 - u[a]) / in[a]);
        else if (in[a] < 0)
            way = fmin(way, (-0.5 - u[a]) / in[a]);
    }
    return way;
}

static double shade_depth(const struct rec_shade *s, const float *f, const double u[3],
                          const double d[3])
{
    const struct rec_grid *g = &s->grid;
    double in[3], sum = 0, h = INFINITY, way = shade_way(g, u, d, in);
    for (int a = 0; a < 3; a++)
        h = fmin(h, (g->max[a] - g->min[a]) / g->n[a]);
    int steps = (int)ceil(way / h);
    for (int k = 0; k < steps; k++) {
        double at = way * (k + 0.5) / steps, x[3];
        for (int a = 0; a < 3; a++)
            x[a] = u[a] + at * in[a];
        sum += shade_f(g, f, x) * way / steps;
    }
    return sum;
}

void rec_shade_at(const struct rec_shade *s, const float *f, int32_t index, double tau[3])
{
    const struct rec_grid *g = &s->grid;
    const double u[3] = {index % g->n[0], index / g->n[0] % g->n[1],
                         (double)(index / g->n[0] / g->n[1])};
    tau[0] = tau[1] = tau[2] = 0;
    for (size_t c = 0; c < s->n; c++) {
        double d[3], length = 0;
        for (int a = 0; a < 3; a++) {
            double x = g->min[a] + (u[a] + 0.5) * (g->max[a] - g->min[a]) / g->n[a];
            d[a] = s->eye[c].at[a] - (s->eye[c].from_far ? 0 : x);
            length += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(length);
        double D = shade_depth(s, f, u, d);
        for (int q = 0; q < 3; q++)
            tau[q] += exp(-s->k[q] * D) / (double)s->n;
    }
}
