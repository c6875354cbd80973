/* points.h - volumes of any grid at the same points. */
#ifndef BENCH_POINTS_H
#define BENCH_POINTS_H
#include "curve.h"

/* Emission of a volume at x, channel by channel; nothing outside. */
static inline void volume_at(const struct rec_grid *g, const float *dense, size_t nch,
                             const double x[3], double out[3])
{
    int32_t i[3];
    double t[3];
    for (size_t ch = 0; ch < nch; ch++)
        out[ch] = 0;
    for (int a = 0; a < 3; a++) {
        double u = (x[a] - g->min[a]) / rec_grid_h(g, a) - 0.5;
        i[a] = (int32_t)floor(g->basis == REC_BOX ? u + 0.5 : u);
        t[a] = g->basis == REC_BOX ? 0 : u - i[a];
    }
    for (int c = 0; c < 8; c++) {
        int32_t k[3];
        double w = 1;
        for (int a = 0; a < 3; a++) {
            k[a] = i[a] + (c >> a & 1);
            w *= c >> a & 1 ? t[a] : 1 - t[a];
            w *= k[a] >= 0 && k[a] < g->n[a];
        }
        for (size_t ch = 0; ch < nch && w > 0; ch++)
            out[ch] += w * dense[(size_t)rec_grid_index(g, k[0], k[1], k[2]) * nch + ch];
    }
}

/* The grid with `along` voxels a metre around the middle of a box, 0: as many as rec_rig_finest says. */
static inline void regrid(struct rec_rig *rig, const struct rec_grid *box, int32_t along)
{
    struct rec_grid *g = &rig->grid;
    *g = *box;
    if (along == 0) {
        CHECK(rec_rig_finest(rig, 1, g->n));
        return;
    }
    for (int a = 0; a < 3; a++) {
        double side = box->max[a] - box->min[a], mid = box->min[a] + side / 2;
        g->n[a] = (int32_t)ceil(side * along - 1e-9);
        g->min[a] = mid - 0.5 * g->n[a] / along;
        g->max[a] = mid + 0.5 * g->n[a] / along;
    }
}

#endif
