/* centre.h - where the centre of a voxel is: (1) of recon/geom/grid.h. */
#ifndef CENTRE_H
#define CENTRE_H
#include "recon/geom/grid.h"

static inline void grid_centre(const struct rec_grid *g, int32_t index, double x[3])
{
    int32_t c[3];
    rec_grid_ijk(g, index, c);
    for (int a = 0; a < 3; a++)
        x[a] = g->min[a] + (c[a] + 0.5) * rec_grid_h(g, a);
}
#endif
