/* temporal.h - a prediction of a frame from the volume before it, and the trust in that prediction.
 *
 *     xhat(q) = previous(q - u(q)),   u: flow.h, from the volume before to this frame's start    (1)
 * The default solver then penalises x - xhat where it penalised x (pcg.c, (1b)).  Trust is measured in the pictures,
 * which xhat has not used.  With m rows:
 *     share = m sigma^2 / p,   p = ||W^(1/2) (A previous(u) - b)||^2,  s = ||W^(1/2) (A start - b)||^2
 *     trust = ramp(share; 0.3, 0.6) ramp(p / s; 1.3, 1.15)                                             (2)
 *     lambda: (1 - trust / 2) of that without, nu = trust, a = 0.9 trust
 * The smallest trust of the channels counts, because in a dim channel everything is noise.
 * share: the part of the prediction's misfit that is noise; at 1 % noise, and after a jump, it is nearly 0.  p / s:
 * the start was fitted to b, so a prediction that misses b by no more is as good as possible.  If trust is 0 or the
 * noise unknown, the term is off, and the solve has the same bits as without it.
 * The prediction is recursive: the volume before was solved with the one before that, so the noise of several frames
 * averages out.
 * Threads: one caller per object.  Same bits for any number of threads.  Allocates nothing after ..._new. */
#ifndef REC_TEMPORAL_H
#define REC_TEMPORAL_H
#include "recon/solve/flow.h"
#include "recon/solve/problem.h"

typedef struct rec_temporal rec_temporal;

/* Work areas for volumes on g, cs floats a voxel.  Errors: PVX_ENOMEM.  Owner: caller. */
PVX_MUST_CHECK pvx_err rec_temporal_new(const struct rec_grid *g, int cs, rec_temporal **out);
void rec_temporal_free(rec_temporal **t);

/* Sets the prediction in pb, which has its start x [n][cs] from coarser grids.  previous: on the same grid.  Returns
 * its trust, 0: off.  pb borrows the prediction until it is solved. */
double rec_temporal_expect(rec_temporal *t, rec_problem *pb, const struct rec_flow_volume *previous,
                           const float *x);

#endif
