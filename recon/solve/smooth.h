/* smooth.h - the smoothness operator of the solvers: second differences on the active voxels.
 *
 *     (L x)_q = sum over axes a_i (2 x_q - x_(q-) - x_(q+)),  a_i = (h_min/h_i)^2             (1)
 * q-, q+: neighbours of voxel q along axis i.  A neighbour that is not active has the value 0: nothing burns
 * outside the hull, so a flame has to fade towards the hull's edge.  L is symmetric.  ||L x||^2 penalises
 * curvature.  It assumes a field with a power spectrum ~ k^-4, close to the k^-11/3 of a scalar mixed by
 * turbulence (Kolmogorov; Obukhov, Izv. AN SSSR 13:58, 1949).  First differences assume k^-2, which is far too
 * rough: they cost 15 to 40 % more error on every flame that was tried (NUMERICS.md).
 * Consecutive voxels along x mostly have their neighbours at the same distances in the list of active voxels.
 * Such a run of voxels is a plain loop over seven contiguous pieces of x.
 * Private to the solvers. */
#ifndef REC_SMOOTH_H
#define REC_SMOOTH_H
#include "recon/matrix/subsys.h"
#include "recon/simd/wide.h"

/* A run of active voxels.  Their neighbours are given as distances in the list, 0 if there is none. */
struct rec_run {
    int32_t end;    /* the first voxel after it */
    int32_t room;   /* how many voxels after it can be read at the same distances */
    int32_t far[6]; /* to -, + of each axis */
    uint32_t have;  /* bit 2i, 2i+1: has a neighbour at -, + of axis i */
};

/* Voxels [q0,q1). */
struct rec_span {
    int32_t q0, q1;
};

struct rec_smooth {
    struct rec_run
        *run;           /* [n] the runs of voxels [q0,q1) of one rec_smooth_runs call begin at q0 */
    float *diag2;       /* [n] diagonal of L L */
    float axis[3];      /* a_i */
    float centre[64];   /* by `have`: factor of x_q in (1), plus a_i for each missing neighbour,
                            since x_q itself is read in its place */
    float diag2_of[64]; /* by `have` */
};

/* Fill axis, centre, diag2_of for a grid. */
void rec_smooth_init(struct rec_smooth *s, const struct rec_grid *g);
/* Fill run and diag2 of the columns [q0,q1) of a. */
void rec_smooth_runs(struct rec_smooth *s, const struct rec_subsys *a, int32_t q0, int32_t q1);

#define REC_SMOOTH_PAD (REC_WIDE - 1)
/* (1) at the first `end` floats of v, which are of one run.  Up to REC_SMOOTH_PAD more are written if they can be
 * read: that is faster than a check for each. */
REC_INLINE void rec_smooth_run(const struct rec_smooth *s, const struct rec_run *e, const float *v,
                               size_t cs, size_t end, float *out)
{
    const float c = s->centre[e->have], a = s->axis[0], b = s->axis[1], d = s->axis[2], *n[6];
    size_t up = (size_t)e->room * cs >= REC_SMOOTH_PAD ? REC_SMOOTH_PAD : 0;
    size_t whole = (end + up) / REC_WIDE * REC_WIDE;
    for (int f = 0; f < 6; f++)
        n[f] = v + e->far[f] * (ptrdiff_t)cs;
    for (size_t k = 0; k < whole; k += REC_WIDE) {
        rec_fw x = rec_wide(n[0], k, REC_WIDE) + rec_wide(n[1], k, REC_WIDE);
        rec_fw y = rec_wide(n[2], k, REC_WIDE) + rec_wide(n[3], k, REC_WIDE);
        rec_fw z = rec_wide(n[4], k, REC_WIDE) + rec_wide(n[5], k, REC_WIDE);
        rec_put_wide(out, k, REC_WIDE,
                     rec_wide_splat(c) * rec_wide(v, k, REC_WIDE) -
                         (rec_wide_splat(a) * x + rec_wide_splat(b) * y + rec_wide_splat(d) * z));
    }
    for (size_t k = whole; k < end; k++)
        out[k] = c * v[k] -
                 (a * (n[0][k] + n[1][k]) + b * (n[2][k] + n[3][k]) + d * (n[4][k] + n[5][k]));
}
/* (1) at the voxels `of` of v [n][cs] into out, which has room for REC_SMOOTH_PAD more floats.  `run`: in, the run of
 * the first voxel; out, the run of the voxel after the last. */
REC_INLINE void rec_smooth_over(const struct rec_smooth *s, const struct rec_run **run,
                                const float *v, size_t cs, struct rec_span of, float *out)
{
    const struct rec_run *e = *run;
    for (int32_t q = of.q0, to; q < of.q1; q = to) {
        to = e->end < of.q1 ? e->end : of.q1;
        rec_smooth_run(s, e, v + (size_t)q * cs, cs, (size_t)(to - q) * cs,
                       out + (size_t)(q - of.q0) * cs);
        e += to == e->end;
    }
    *run = e;
}

#endif
