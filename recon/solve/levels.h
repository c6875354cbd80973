/* levels.h - the same frame set on coarser grids, and the start that they give on the fine one.
 *
 * Level l has voxels of 2^l times the size and pictures averaged over 2^l x 2^l bins, so a pass over it costs an
 * eighth of one over the level below.  The large shapes, for which CG needs many iterations, are settled there.  The
 * coarse columns are those with an active voxel among their children.  The weight of the smoothness term is an eighth
 * per level (problem.h).
 * Refinement: coarse coefficients are means over eight voxels.  Along each axis, the means of the two halves of c_0
 * between c_- and c_+ are
 *     c_0 -+ (c_+ - c_-) / 8                                                                (1)
 * This is exact for parabolas and keeps the mean; negative results become 0.
 * Source: cascadic multigrid, Bornemann & Deuflhard, Numer. Math. 75:135, 1996.
 * Threads: one frame set per object at a time.  Allocates nothing after ..._new. */
#ifndef REC_LEVELS_H
#define REC_LEVELS_H
#include "recon/solve/problem.h"

/* The restricted systems of one frame set on all levels.  They travel with the frame set. */
typedef struct rec_levels rec_levels;

/* For the levels of S->coarse; PVX_OK with *out = NULL when S has none.  Borrows S, k, pool. */
PVX_MUST_CHECK pvx_err rec_levels_new(const rec_sysmat *S, const struct rec_kernels *k,
                                      pvx_pool *pool, int cs, rec_levels **out);
void rec_levels_free(rec_levels **l);

/* Makes columns, right-hand sides and restricted systems of all levels.  `fine` is S restricted, `in` its pictures; r
 * as for rec_subsys_restrict. */
void rec_levels_restrict(rec_levels *l, struct rec_restrictor *r, const struct rec_subsys *fine,
                         const struct rec_pictures *in);

/* Work areas for the descent from the coarsest level, for any frame set of S; then the data of one frame set. */
struct rec_descent {
    rec_problem *problem; /* one level's at a time */
    float *x[2];          /* [1 + voxels of the first level][cs] zero, then a level's solution */
    float *spare;         /* [voxels of S][cs] of rec_levels_start */
    size_t voxels;
    int cs;

    const rec_levels *levels; /* in: as rec_levels_restrict left them */
    int64_t deadline_ns;      /* in: as in rec_solve_params */
    uint32_t iterations;      /* out: the sum over levels */
    double misfit2[4];        /* out: of the finest of them, as in rec_solve_report */
};

/* S must have coarser levels.  Errors: PVX_ENOMEM, PVX_EINVAL (nch); there is nothing to free then. */
PVX_MUST_CHECK pvx_err rec_descent_init(struct rec_descent *d, const rec_sysmat *S, int nch);
void rec_descent_fini(struct rec_descent *d); /* zeroed content is fine */

/* Solves d->levels from the coarsest down.  x [n][cs]: the result refined to the columns of `fine`, which has been
 * weighed. */
void rec_levels_solve(const rec_problem *fine, struct rec_descent *d, float *x);
/* The same as the start of `pb`.  Its misfit raises the weight of the smoothness term of `pb` (rec_problem_misfit).
 * spare: NULL, or a work area [n][cs]; x then holds an earlier volume.  That volume, scaled (start.h), stays the
 * start if it leaves the smaller residual; after a jump of the flame it does not.  True: the start is the earlier
 * volume. */
bool rec_levels_start(rec_problem *pb, struct rec_descent *d, float *x, float *spare);

#endif
