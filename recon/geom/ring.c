/* The simulated rig. */
#include "recon/geom/rig.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/mem.h"

/* Largest |x| or |y| (tangent of the angle off axis) of the volume's corners in this camera. */
static double ring_spread(const struct rec_grid *g, const struct rec_camera *c, double least_depth)
{
    double worst = 0;
    for (int i = 0; i < 8; i++) {
        double p[3], X[3] = {i & 1 ? g->max[0] : g->min[0], i & 2 ? g->max[1] : g->min[1],
                             i & 4 ? g->max[2] : g->min[2]};
        for (int a = 0; a < 3; a++)
            p[a] = c->R[3 * a] * X[0] + c->R[3 * a + 1] * X[1] + c->R[3 * a + 2] * X[2] + c->t[a];
        double depth = fmax(p[2], least_depth);
        worst = fmax(worst, fmax(fabs(p[0]), fabs(p[1])) / depth);
    }
    return worst;
}

pvx_err rec_rig_ring(size_t n, double radius, int32_t w, int32_t h, int32_t voxels,
                     struct rec_rig *out)
{
    memset(out, 0, sizeof *out);
    if (n < 1 || n > REC_MAX_CAMERAS || !(radius > 1e-3 && radius < 1e5) || w < 1 || w > 16384 ||
        h < 1 || h > 16384 || voxels < 1 || voxels > REC_GRID_MAX)
        return PVX_EINVAL;
    out->cameras = pvx_calloc(n, sizeof *out->cameras);
    if (out->cameras == NULL)
        return PVX_ENOMEM;
    out->n_cameras = n;
    out->grid =
        (struct rec_grid){{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {voxels, voxels, voxels}, REC_BOX};
    double worst = 0;
    for (size_t i = 0; i < n; i++) {
        struct rec_camera *c = &out->cameras[i];
        /* Uneven steps, as in a rig set up by hand: with even ones and an even n every view would
         * have an opposite one that sees almost the same rays. */
        double golden = 0.6180339887498949 * (double)i;
        double angle = 6.283185307179586 * ((double)i + 0.3 * (golden - floor(golden))) / (double)n;
        double at[3] = {radius * cos(angle), radius * sin(angle), i % 2 == 0 ? 0.65 : 0.35};
        static const double aim[3] = {0, 0, 0.5};
        snprintf(c->name, sizeof c->name, "cam%zu", i);
        rec_camera_look(at, aim, c);
        c->width = w;
        c->height = h;
        static const double dist[8] = {-0.05, 0.01, 5e-4, -3e-4};
        memcpy(c->dist, dist, sizeof dist);
        c->gain[0] = c->gain[1] = c->gain[2] = 1;
        worst = fmax(worst, ring_spread(&out->grid, c, 0.25 * radius));
    }
    for (size_t i = 0; i < n; i++) {
        struct rec_camera *c = &out->cameras[i];
        c->fx = 0.75 * 0.5 * (w < h ? w : h) / worst;
        c->fy = c->fx * 1.001;
        c->cx = 0.5 * (w - 1) + 0.003 * w;
        c->cy = 0.5 * (h - 1) - 0.004 * h;
    }
    return PVX_OK;
}
