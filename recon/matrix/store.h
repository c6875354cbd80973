/* store.h - the memory of a matrix, and the data of it that is known before its entries (sysmat.c).  Not for other
 * modules. */
#ifndef REC_STORE_H
#define REC_STORE_H
#include "recon/matrix/active.h"

#define REC_SYSMAT_LEVELS_MAX 8 /* 1024 voxels a side have 7 */

/* rec_sysmat.priv: a mapped file (of the finest level: all its levels), or (map NULL) every array
 * from the heap, unless it is in the mapping of a finer level. */
struct rec_sysmat_store {
    void *map;
    size_t map_bytes;
    bool borrowed;
    bool sparse; /* windows and footprints are reserved address space */
};

/* An empty matrix with `n_cameras` blocks, all arrays NULL.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_alloc(size_t n_cameras, rec_sysmat **out);

/* row0 from the blocks' bw, bh.  PVX_ERANGE + diag: more than 2^31-1 rows. */
PVX_MUST_CHECK pvx_err rec_sysmat_number_rows(rec_sysmat *m, struct pvx_diag *d);

/* `bytes` from the heap, aligned but not zeroed.  free(); NULL: out of memory. */
void *rec_sysmat_array(uint64_t bytes);

/* Number of columns: N, or the kept ones. */
size_t rec_sysmat_columns(const rec_sysmat *m);
static inline size_t rec_sysmat_voxel(const rec_sysmat *m, size_t column)
{
    return m->active != NULL ? m->active->column[column] : column;
}

/* Bytes of address space of a level that keeps a part. */
struct rec_sparse_bytes {
    size_t at, w, fp;
};
static inline struct rec_sparse_bytes rec_sparse_bytes(const rec_sysmat *m)
{
    size_t windows = rec_grid_count(&m->grid) * (size_t)m->win.slots;
    return (struct rec_sparse_bytes){.at = windows * sizeof *m->win.at,
                                     .w = windows * rec_window_size(&m->win) + REC_WINDOWS_PAD,
                                     .fp = rec_brick_places(&m->grid) * sizeof(struct rec_rect)};
}

/* Reserves address space with small pages, for data of which only scattered pages are used.  pvx_unreserve(). */
void *rec_sysmat_sparse(size_t bytes);

/* Sets everything of the finest level, its rows included, except its entries and footprints.  p is resolved. */
PVX_MUST_CHECK pvx_err rec_sysmat_finest_frame(const struct rec_rig *rig,
                                               const struct rec_sysmat_params *p, rec_sysmat *m,
                                               struct pvx_diag *d);
/* (2) of sysmat.h for a grid.  On a coarser grid it is exactly twice that of the finer one. */
float rec_sysmat_unit(const struct rec_grid *g);

#endif
