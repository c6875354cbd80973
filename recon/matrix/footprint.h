/* footprint.h - which bins the support of a voxel or brick can reach (footprint.c).  Not for other modules. */
#ifndef REC_FOOTPRINT_H
#define REC_FOOTPRINT_H
#include "recon/matrix/entries.h"

/* Sets all footprints to unseen.  Places without a voxel stay so. */
void rec_no_footprints(const rec_sysmat *m, struct rec_rect *fp);
/* Footprints of all columns of camera c from its lens, widened to every entry that is there.
 * A support that is partly behind a body is treated like one that is partly behind the camera: if it has entries, its
 * footprint is the whole image, which never carves; otherwise it is unseen.
 * fp [rec_brick_places] out.  Parallel over slabs of voxels, same bits for any thread count.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_footprints(const rec_sysmat *m, const struct rec_camera *c,
                                             const struct rec_sysmat_block *b,
                                             const struct rec_entries *part, pvx_pool *pool,
                                             struct rec_rect *fp);

/* Footprints of whole bricks in camera c, as far as they are known without entries, into brick [bricks].  A brick is
 * projected as one support.  Its footprint contains those of its voxels, and may be larger by the bend of the lens
 * along the brick.  depth as in rec_entries.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_brick_footprints(const rec_sysmat *m, const struct rec_camera *c,
                                                   const struct rec_sysmat_block *b, float *depth,
                                                   pvx_pool *pool, struct rec_rect *brick);

/* Footprints of camera c on all levels of m, each of which keeps a part, into their blocks.  part: entries of the
 * finest level; met [N bits]: its columns that have entries at all.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_active_footprints(const rec_sysmat *m, size_t c,
                                                    const struct rec_camera *camera,
                                                    const struct rec_entries *part,
                                                    const _Atomic uint64_t *met, pvx_pool *pool);

#endif
