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
        s->diag2_of[have] = (float)diag2;
    }
}

/* End of the consecutive columns from q on.  Columns ascend, so if two of them differ by as much as their places in
 * the list, all voxels between them are in the list. */
static int32_t contiguous(const struct rec_subsys *a, int32_t q)
{
    for (int32_t by = 16; by > 0; by /= 4)
        while (q + by < a->n && a->col[q + by] == a->col[q] + by)
            q += by;
    return q + 1;
}

/* Finds the neighbours of q at a fixed offset.  col ascends, so `at` only moves forward with q. */
struct cursor {
    bool inside;     /* the neighbours are in the grid */
    int32_t step;    /* offset of the neighbour's voxel number */
    int32_t at, end; /* first column not before the neighbour; end of the consecutive ones */
};
/* Whether column q, voxel number v, has this neighbour.  *len: limited to the number of columns from q on for which
 * the answer holds. */
static bool has_neighbour(const struct rec_subsys *a, struct cursor *c, int32_t v, int32_t *len)
{
    if (!c->inside)
        return false;
    while (c->at < a->n && a->col[c->at] < v + c->step)
        c->at++;
    if (c->at == a->n)
        return false;
    int32_t gap = a->col[c->at] - (v + c->step);
    if (gap == 0 && c->at >= c->end)
        c->end = contiguous(a, c->at);
    int32_t holds = gap == 0 ? c->end - c->at : gap;
    *len = holds < *len ? holds : *len;
    return gap == 0;
}

void rec_smooth_runs(struct rec_smooth *s, const struct rec_subsys *a, int32_t q0, int32_t q1)
{
    const struct rec_grid *g = &a->S->grid;
    const int32_t layer = g->n[0] * g->n[1];
    struct cursor c[4] = {{.step = -g->n[0]}, {.step = g->n[0]}, {.step = -layer}, {.step = layer}};
    struct rec_run *run = s->run + q0;
    int32_t ijk[3] = {0}, row = q0, len; /* row: end of the consecutive voxels of a row */
    for (int f = 0; f < 4 && q0 < q1; f++)
        c[f].at = rec_first_column(a->col, a->n, a->col[q0] + c[f].step);
    for (int32_t q = q0; q < q1; q += len, ijk[0] += len, run++) {
        int32_t v = a->col[q];
        if (q == row) {
            rec_grid_ijk(g, v, ijk);
            int32_t room = q + g->n[0] - ijk[0];
            row = contiguous(a, q);
            row = row < room ? row : room;
            for (int f = 0; f < 4; f++) {
                int axis = 1 + f / 2;
                c[f].inside = f % 2 ? ijk[axis] + 1 < g->n[axis] : ijk[axis] > 0;
            }
        }
        bool before = q > 0 && a->col[q - 1] == v - 1 && ijk[0] > 0, after = q + 1 < row;
        len = before && after ? row - 1 - q : 1;
        len = len < q1 - q ? len : q1 - q;
        *run = (struct rec_run){.far = {-(int32_t)before, after},
                                .have = (uint32_t)before | (uint32_t)after << 1};
        for (int f = 0; f < 4; f++)
            if (has_neighbour(a, &c[f], v, &len)) {
                run->far[2 + f] = c[f].at - q;
                run->have |= 4u << f;
            }
        int32_t furthest = 0;
        for (int f = 1; f < 6; f += 2)
            furthest = run->far[f] > furthest ? run->far[f] : furthest;
        for (int f = 0; f < 4; f++) /* their neighbours are consecutive too */
            c[f].at += run->have >> (2 + f) & 1 ? len : 0;
        run->end = q + len;
        run->room = a->n - run->end - furthest;
        for (int32_t i = q; i < run->end; i++)
            s->diag2[i] = s->diag2_of[run->have];
    }
}
