/* flow.h - the motion from one volume of emission to the next: 3-D optical flow on a coarse grid.
 *
 *     to(x) = from(x - u(x)),   E(u) = sum (to - w + G.(u - u0))^2 + alpha ||grad u||^2  ->  min     (1)
 * w: `from` moved by u0, G: mean gradient of w and `to`, alpha: a share of the mean of |G|^2 weighted by itself.
 * The first grid is so coarse that a flame moves by about one cell.  Each next grid is finer by a factor of two.
 * Each grid gets some rounds of (1), solved by Jacobi's iteration; no round moves u by more than one cell.
 * The brightness of a cell is the sum of the channels over its voxels.
 * Source: Horn & Schunck, Artif. Intell. 17:185, 1981, in three dimensions; coarse to fine: Anandan, IJCV 2:283,
 * 1989.  Callers take u as fixed data: there is no adjoint.
 * Threads: one caller per object.  Same bits for any number of threads.  Allocates nothing after ..._new. */
#ifndef REC_FLOW_H
#define REC_FLOW_H
#include <stdbool.h>
#include "base/pool.h"
#include "recon/geom/grid.h"

typedef struct rec_flow rec_flow;

/* For volumes on g.  Errors: PVX_ENOMEM.  Owner: caller. */
PVX_MUST_CHECK pvx_err rec_flow_new(const struct rec_grid *g, rec_flow **out);
void rec_flow_free(rec_flow **f);

/* Values [n][cs], nch of them counted, at voxels index [n] of g. */
struct rec_flow_volume {
    int32_t n;
    const int32_t *index;
    const float *value;
    int cs, nch;
};
void rec_flow_find(rec_flow *f, const struct rec_flow_volume *from,
                   const struct rec_flow_volume *to, pvx_pool *pool);
/* u of the last find at voxel (i, j, k), in voxels. */
void rec_flow_at(const rec_flow *f, const int32_t ijk[3], float u[3]);

#endif
