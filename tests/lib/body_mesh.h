/* body_mesh.h - closed surfaces for tests, and one triangle by another formula than the tree's. */
#ifndef TESTS_BODY_MESH_H
#define TESTS_BODY_MESH_H
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The twelve triangles of a box. */
static inline void box_mesh(const double min[3], const double max[3], double t[12 * 9])
{
    static const int faces[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6},
                                     {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7},
                                     {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
    for (int f = 0; f < 12; f++)
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                t[f * 9 + k * 3 + a] = faces[f][k] >> a & 1 ? max[a] : min[a];
}

/* A ball of 2 n (n-1) triangles.  Owner: caller. */
static inline double *sphere_mesh(int n, double radius, size_t *triangles)
{
    double *t = malloc((size_t)(2 * n * n) * 9 * sizeof *t), *p = t;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double q[4][3]; /* (i,j) (i+1,j) (i+1,j+1) (i,j+1) */
            for (int c = 0; c < 4; c++) {
                int a = i + (c == 1 || c == 2), b = (j + (c >= 2)) % n;
                double th = M_PI * a / n, ph = 2 * M_PI * b / n;
                double s = a == 0 || a == n ? 0 : sin(th);
                q[c][0] = radius * s * cos(ph);
                q[c][1] = radius * s * sin(ph);
                q[c][2] = radius * (a == 0 ? 1 : a == n ? -1 : cos(th));
            }
            static const int split[2][3] = {{0, 1, 2}, {0, 2, 3}};
            for (int h = 0; h < 2; h++) {
                if ((h == 0 && i == n - 1) || (h == 1 && i == 0)) /* no area at the poles */
                    continue;
                for (int c = 0; c < 3; c++, p += 3)
                    memcpy(p, q[split[h][c]], 3 * sizeof *p);
            }
        }
    *triangles = (size_t)(p - t) / 9;
    return t;
}

/* Where a ray crosses the plane of a triangle, if on the inner side of its three edges. */
static inline double plane_hit(const double *t, const double o[3], const double d[3])
{
    double n[3], e[3][3], up = 0, down = 0, x[3];
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            e[k][a] = t[(k + 1) % 3 * 3 + a] - t[k * 3 + a];
    for (int a = 0; a < 3; a++)
        n[a] = e[0][(a + 1) % 3] * e[1][(a + 2) % 3] - e[0][(a + 2) % 3] * e[1][(a + 1) % 3];
    for (int a = 0; a < 3; a++) {
        up += n[a] * (t[a] - o[a]);
        down += n[a] * d[a];
    }
    if (down == 0 || up / down < 0)
        return INFINITY;
    for (int a = 0; a < 3; a++)
        x[a] = o[a] + up / down * d[a];
    for (int k = 0; k < 3; k++) {
        double side = 0;
        for (int a = 0; a < 3; a++) {
            int b = (a + 1) % 3, c = (a + 2) % 3;
            side += n[a] * (e[k][b] * (x[c] - t[k * 3 + c]) - e[k][c] * (x[b] - t[k * 3 + b]));
        }
        if (side < 0)
            return INFINITY;
    }
    return up / down;
}

#endif
