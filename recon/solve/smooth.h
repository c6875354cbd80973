/* smooth.h - the smoothness operator of the solvers: second differences on the active voxels.
 *
 *     (L x)_q = sum over axes a_i (2 x_q - x_(q-) - x_(q+)),  a_i = (h_min/h_i)^2             (1)
 * q-, q+: neighbours of voxel q along axis i.  Where the neighbour is not active its value is 0: the
 * hull says that nothing burns there, so a flame has to fade towards the hull's edge.  L is
 * symmetric.  ||L x||^2 penalises curvature: the field it expects has a power spectrum ~ k^-4, close
 * to the k^-11/3 of a scalar mixed by turbulence (Kolmogorov; Obukhov, Izv. AN SSSR 13:58, 1949),
 * where first differences expect k^-2, far too rough: they cost 15 to 40 % more error on every flame
 * that was tried (NUMERICS.md).
 * Private to the solvers. */
#ifndef REC_SMOOTH_H
#define REC_SMOOTH_H
#include "recon/simd/lanes.h"
#include "recon/matrix/subsys.h"

/* Neighbours of active voxel q as distances in the list of active voxels, 0 where there is none.
 * along y fewer than two rows of voxels lie between, so 16 bits do. */
struct rec_near {
    int32_t z[2]; /* to z-, z+ */
    int16_t y[2];
    uint32_t have; /* bit 2i, 2i+1: has a neighbour at -, + of axis i */
};

struct rec_smooth {
    struct rec_near *near; /* [n] */
    float axis[3];         /* a_i */
    float centre[64];      /* by `have`: factor of x_q in (1), plus a_i for each missing neighbour,
                              since x_q itself is read in its place */
    float diag2[64];       /* by `have`: diagonal of L L */
};

/* Fill axis, centre, diag2 for a grid. */
void rec_smooth_init(struct rec_smooth *s, const struct rec_grid *g);
/* Fill near[q0..q1) for the columns of a. */
void rec_smooth_near(struct rec_smooth *s, const struct rec_subsys *a, int32_t q0, int32_t q1);

/* (1) at q; v [n][cs]. */
REC_INLINE rec_f4 rec_smooth_at(const struct rec_smooth *s, const float *v, int32_t q, size_t cs)
{
    const struct rec_near *e = &s->near[q];
    ptrdiff_t o = q, lo = o - (ptrdiff_t)(e->have & 1), hi = o + (ptrdiff_t)(e->have >> 1 & 1);
    rec_f4 x = rec_ld(v, (size_t)lo, cs) + rec_ld(v, (size_t)hi, cs);
    rec_f4 y = rec_ld(v, (size_t)(o + e->y[0]), cs) + rec_ld(v, (size_t)(o + e->y[1]), cs);
    rec_f4 z = rec_ld(v, (size_t)(o + e->z[0]), cs) + rec_ld(v, (size_t)(o + e->z[1]), cs);
    return rec_splat(s->centre[e->have]) * rec_ld(v, (size_t)o, cs) -
           (rec_splat(s->axis[0]) * x + rec_splat(s->axis[1]) * y + rec_splat(s->axis[2]) * z);
}

#endif
