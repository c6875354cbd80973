/* levels.h - where the solver starts: the same frame set solved on coarser grids first.
 *
 * Level l has voxels of 2^l times the size and pictures averaged over 2^l x 2^l bins, so a pass over
 * it costs an eighth of one over the level below; what CG needs many iterations for, the large
 * shapes, is settled there.  The coarse columns are those with an active voxel among their children,
 * the weight of the smoothness term is an eighth per level (solve.h).
 * Finer again: the coarse coefficients are means over eight voxels, and along each axis the means of
 * the halves of c_0 between c_- and c_+ are
 *     c_0 -+ (c_+ - c_-) / 8                                                                (1)
 * exact for parabolas, the mean kept; negative results become 0.
 * Source: cascadic multigrid, Bornemann & Deuflhard, Numer. Math. 75:135, 1996.
 * Threads: one frame set per object at a time.  Allocates nothing after rec_levels_new. */
#ifndef REC_LEVELS_H
#define REC_LEVELS_H
#include "recon/solve/solve.h"

typedef struct rec_levels rec_levels;

/* For the levels of S->coarse; PVX_OK with *out = NULL when S has none.  Borrows S, k, pool. */
PVX_MUST_CHECK pvx_err rec_levels_new(const rec_sysmat *S, const struct rec_kernels *k,
                                      pvx_pool *pool, int nch, rec_levels **out);
void rec_levels_free(rec_levels **l);

/* Columns, right-hand sides and restricted systems of all levels; `fine` is S restricted, b and w are
 * its right-hand side and weights in S's row space; lanes: w is [row space][4] (solve.h), and cs 4. */
void rec_levels_restrict(rec_levels *l, const struct rec_subsys *fine, const float *b,
                         const float *w, bool lanes);

/* Solve from the coarsest level down and put the start for `fine` into x [n][cs].  `weight`: that of
 * the fine level (rec_solve_weight).  *iterations: the sum over levels.  misfit2: of the
 * finest of them, as in rec_solve_report. */
void rec_levels_solve(rec_levels *l, const struct rec_subsys *fine, const double weight[4],
                      int64_t deadline_ns, float *x, uint32_t *iterations, double misfit2[4]);

#endif
