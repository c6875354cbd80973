/* sysmat_priv.h - what the files of sysmat.h share: where a matrix's memory is, and the parts of its
 * construction.  Not for other modules. */
#ifndef REC_SYSMAT_PRIV_H
#define REC_SYSMAT_PRIV_H
#include "recon/sysmat.h"

/* rec_sysmat.priv: a mapped file, or (map NULL) every array of every block from the heap. */
struct rec_sysmat_store {
    void *map;
    size_t map_bytes;
};

/* An empty matrix with `n_cameras` blocks of NULL arrays.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_alloc(size_t n_cameras, rec_sysmat **out);

/* Bytes of the four arrays of a block: colptr, row, val, fp. */
void rec_sysmat_section_bytes(const rec_sysmat *m, const struct rec_sysmat_block *b,
                              uint64_t bytes[4]);

/* Footprints of all columns of camera c from its lens, widened to every entry that is there.
 * fp [N] out.  Parallel over slabs of voxels, same bits for any thread count.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_footprints(const rec_sysmat *m, const struct rec_camera *c,
                                             const struct rec_sysmat_block *b, pvx_pool *pool,
                                             struct rec_rect *fp);
#endif
