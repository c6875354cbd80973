/* levels.h - the same frame set on coarser grids, and what they say of the fine one.
 *
 * Level l has voxels of 2^l times the size and pictures averaged over 2^l x 2^l bins, so a pass over
 * it costs an eighth of one over the level below; what CG needs many iterations for, the large
 * shapes, is settled there.  The coarse columns are those with an active voxel among their children,
 * the weight of the smoothness term is an eighth per level (problem.h).
 * Finer again: the coarse coefficients are means over eight voxels, and along each axis the means of
 * the halves of c_0 between c_- and c_+ are
 *     c_0 -+ (c_+ - c_-) / 8                                                                (1)
 * exact for parabolas, the mean kept; negative results become 0.
 * Source: cascadic multigrid, Bornemann & Deuflhard, Numer. Math. 75:135, 1996.
 * Threads: one frame set per object at a time.  Allocates nothing after ..._new. */
#ifndef REC_LEVELS_H
#define REC_LEVELS_H
#include "recon/solve/problem.h"

/* The restricted systems of one frame set on all levels: travels with it. */
typedef struct rec_levels rec_levels;

/* For the levels of S->coarse; PVX_OK with *out = NULL when S has none.  Borrows S, k, pool. */
PVX_MUST_CHECK pvx_err rec_levels_new(const rec_sysmat *S, const struct rec_kernels *k,
                                      pvx_pool *pool, int cs, rec_levels **out);
void rec_levels_free(rec_levels **l);

/* Columns, right-hand sides and restricted systems of all levels; `fine` is S restricted, `in` its
 * pictures; r as for rec_subsys_restrict. */
void rec_levels_restrict(rec_levels *l, struct rec_restrictor *r, const struct rec_subsys *fine,
                         const struct rec_pictures *in);

/* Down through the levels: work areas for any frame set of S, then one frame set's. */
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

/* S has coarser levels.  Errors: PVX_ENOMEM, PVX_EINVAL (nch); then there is nothing to free. */
PVX_MUST_CHECK pvx_err rec_descent_init(struct rec_descent *d, const rec_sysmat *S, int nch);
void rec_descent_fini(struct rec_descent *d); /* zeroed content is fine */

/* Solve d->levels from the coarsest down; x [n][cs]: what that says of `fine`, which has been weighed. */
void rec_levels_solve(const rec_problem *fine, struct rec_descent *d, float *x);
/* The same as the start of `pb`.  Its misfit raises the weight of the smoothness term of `pb` (rec_problem_misfit).
 * spare: NULL, or a work area [n][cs].  Then x holds an earlier volume.  It stays, scaled (start.h), where it leaves the
 * smaller residual; after a jump of the flame it does not.  True: the start is the earlier volume. */
bool rec_levels_start(rec_problem *pb, struct rec_descent *d, float *x, float *spare);

#endif
