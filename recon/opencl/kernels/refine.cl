/* refine.cl - a start on a grid: (1) of solve/levels.h, and an earlier volume. */

/* Column of the coarse grid at (i,j,k), or -1. */
static inline int coarse_at(__constant const struct rec_cl_geometry *g, __global const int *map, int i, int j, int k)
{
    bool in = i >= 0 && j >= 0 && k >= 0 && i < g->n[0] && j < g->n[1] && k < g->n[2];
    return in ? map[(k * g->n[1] + j) * g->n[0] + i] : -1;
}

/* The children of a lane of a coarse column an item.  n: columns times lanes; g, map, col, x: of the coarse grid. */
__kernel FLAT_ITEMS void refine(uint n, __constant const struct rec_cl_geometry *g, __global const int *restrict map,
                                __global const int *restrict col, __global const float *restrict x,
                                __constant const struct rec_cl_geometry *fine, __global const int *restrict fine_map,
                                __global float *restrict to)
{
    FOR_MINE (e, n) {
        int v = col[e / CS], l = (int)(e % CS);
        int i = v % g->n[0], j = v / g->n[0] % g->n[1], k = v / g->n[0] / g->n[1];
        float in[27], a[2][9], b[4][3];
        for (int o = 0; o < 27; o++) {
            int q = coarse_at(g, map, i + o % 3 - 1, j + o / 3 % 3 - 1, k + o / 9 - 1);
            in[o] = q < 0 ? 0 : x[(size_t)q * CS + l];
        }
        for (int r = 0; r < 9; r++) {
            float d = 0.125f * (in[3 * r + 2] - in[3 * r]);
            a[0][r] = in[3 * r + 1] - d;
            a[1][r] = in[3 * r + 1] + d;
        }
        for (int z = 0; z < 3; z++)
            for (int m = 0; m < 2; m++) {
                float d = 0.125f * (a[m][3 * z + 2] - a[m][3 * z]);
                b[m][z] = a[m][3 * z + 1] - d;
                b[2 + m][z] = a[m][3 * z + 1] + d;
            }
        for (int o = 0; o < 8; o++) { /* child x + 2 y + 4 z */
            float d = 0.125f * (b[o % 4][2] - b[o % 4][0]);
            float y = o < 4 ? b[o % 4][1] - d : b[o % 4][1] + d;
            int q = coarse_at(fine, fine_map, 2 * i + o % 2, 2 * j + o / 2 % 2, 2 * k + o / 4);
            if (q >= 0)
                to[(size_t)q * CS + l] = y > 0 ? y : 0;
        }
    }
}

/* x = value in those of the voxels `index` [n] that are columns. */
__kernel FLAT_ITEMS void earlier(uint n, __global const int *restrict index, __global const lanes *restrict value,
                                 __global const int *restrict map, __global lanes *restrict x)
{
    FOR_MINE (i, n) {
        int q = map[index[i]];
        if (q >= 0)
            x[q] = value[i];
    }
}
