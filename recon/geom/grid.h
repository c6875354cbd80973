/* grid.h - the box in which the flame is reconstructed, and its basis.
 *
 * Right-handed world in metres, z up.  Voxel (i,j,k) along x,y,z, x fastest:
 *     index = (k*ny + j)*nx + i,   centre = min + (i+1/2, j+1/2, k+1/2) * h            (1)
 * A coefficient belongs to the centre of its voxel in both bases.  box: constant in the cell.
 * trilinear: interpolated between centres, falling to zero one spacing outside, so its support
 * reaches h/2 beyond [min,max]. */
#ifndef REC_GRID_H
#define REC_GRID_H
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum rec_basis { REC_BOX, REC_TRILINEAR };
/* The default: with sharp flames the error is limited by the steps of the box basis between voxels, not by noise
 * (tests/bench/RESULTS.md). */
#define REC_BASIS_DEFAULT REC_TRILINEAR

#define REC_GRID_MAX 1024 /* voxels per side */

struct rec_grid {
    double min[3], max[3]; /* m */
    int32_t n[3];          /* voxels along x, y, z; 1..REC_GRID_MAX */
    enum rec_basis basis;
};

static inline size_t rec_grid_count(const struct rec_grid *g)
{
    return (size_t)g->n[0] * (size_t)g->n[1] * (size_t)g->n[2];
}
static inline double rec_grid_h(const struct rec_grid *g, int axis)
{
    return (g->max[axis] - g->min[axis]) / g->n[axis];
}
static inline int32_t rec_grid_index(const struct rec_grid *g, int32_t i, int32_t j, int32_t k)
{
    return (k * g->n[1] + j) * g->n[0] + i;
}
/* Inverse of (1). */
static inline void rec_grid_ijk(const struct rec_grid *g, int32_t index, int32_t ijk[3])
{
    ijk[0] = index % g->n[0];
    ijk[1] = index / g->n[0] % g->n[1];
    ijk[2] = index / g->n[0] / g->n[1];
}
static inline const char *rec_basis_name(enum rec_basis b)
{
    return b == REC_TRILINEAR ? "trilinear" : "box";
}

#ifdef __cplusplus
}
#endif
#endif
