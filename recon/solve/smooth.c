#include "recon/solve/smooth.h"

#include <math.h>

void rec_smooth_init(struct rec_smooth *s, const struct rec_grid *g)
{
    double h_min = fmin(rec_grid_h(g, 0), fmin(rec_grid_h(g, 1), rec_grid_h(g, 2)));
    double a[3], full = 0;
    for (int i = 0; i < 3; i++) {
        a[i] = h_min * h_min / (rec_grid_h(g, i) * rec_grid_h(g, i));
        s->axis[i] = (float)a[i];
        full += 2 * a[i];
    }
    for (int have = 0; have < 64; have++) {
        double centre = full, diag2 = full * full;
        for (int f = 0; f < 6; f++) {
            if (have >> f & 1)
                diag2 += a[f / 2] * a[f / 2];
            else
                centre += a[f / 2];
        }
        s->centre[have] = (float)centre;
        s->diag2[have] = (float)diag2;
    }
}

/* col ascends, so the neighbour at a fixed offset moves forward with q: four cursors, no search. */
void rec_smooth_near(struct rec_smooth *s, const struct rec_subsys *a, int32_t q0, int32_t q1)
{
    const struct rec_grid *g = &a->S->grid;
    const int32_t *col = a->col, n = a->n;
    const int32_t layer = g->n[0] * g->n[1], step[4] = {-g->n[0], g->n[0], -layer, layer};
    int32_t at[4], ijk[3] = {0}, last = -2;
    bool inside[4] = {false};
    if (q0 >= q1)
        return;
    for (int f = 0; f < 4; f++)
        at[f] = rec_first_column(col, n, col[q0] + step[f]);
    for (int32_t q = q0; q < q1; q++) {
        int32_t v = col[q];
        if (v == last + 1 && ijk[0] + 1 < g->n[0]) {
            ijk[0]++;
        } else { /* a new run of voxels along x */
            rec_grid_ijk(g, v, ijk);
            inside[0] = ijk[1] > 0;
            inside[1] = ijk[1] + 1 < g->n[1];
            inside[2] = ijk[2] > 0;
            inside[3] = ijk[2] + 1 < g->n[2];
        }
        last = v;
        int32_t far[4];
        uint32_t have = 0;
        have |= q > 0 && col[q - 1] == v - 1 && ijk[0] > 0;
        have |= (uint32_t)(q + 1 < n && col[q + 1] == v + 1 && ijk[0] + 1 < g->n[0]) << 1;
        for (int f = 0; f < 4; f++) {
            while (at[f] < n && col[at[f]] < v + step[f])
                at[f]++;
            bool is = inside[f] && at[f] < n && col[at[f]] == v + step[f];
            far[f] = is ? at[f] - q : 0;
            have |= (uint32_t)is << (f + 2);
        }
        s->near[q] = (struct rec_near){
            .z = {far[2], far[3]}, .y = {(int16_t)far[0], (int16_t)far[1]}, .have = have};
    }
}
