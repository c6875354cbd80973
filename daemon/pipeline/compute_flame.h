/* compute_flame.h - a frame set of a flame, for measurements: the standard flame (recon/view/flame.h) as S sees it.
 * Threads: one.  Owner: caller. */
#ifndef DMN_COMPUTE_FLAME_H
#define DMN_COMPUTE_FLAME_H
#include "recon/frame/frame.h"

typedef struct dmn_compute_flame dmn_compute_flame;
/* Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_compute_flame_new(const rec_sysmat *S, const struct rec_frame_params *p,
                                             pvx_pool *pool, dmn_compute_flame **out);
void dmn_compute_flame_free(dmn_compute_flame **f);
/* All cameras of a reset slot. */
void dmn_compute_flame_load(const dmn_compute_flame *f, rec_frame *to);
#endif
