/* entries.h - the entries of S while it is built: merged over cameras (merge.c), coarsened (coarse.c), turned into windows
 * (windows.c).  Not for other modules. */
#ifndef REC_ENTRIES_H
#define REC_ENTRIES_H
#include "recon/matrix/store.h"

/* A level while S is built, by columns: the entries of column j are [colptr[j],colptr[j+1]), rows ascending, values
 * in units and > 0.  For one camera: its own columns, rows without row0.  For a part of S: only the kept columns. */
struct rec_entries {
    uint32_t *colptr; /* [columns+1] */
    uint32_t *row;
    uint8_t *val;
    uint64_t nnz;
    float *depth; /* of one camera, or NULL: m to the nearest body in a bin */
};
void rec_entries_free(struct rec_entries *e);

/* Joins the cameras' parts end to end within each column (m must have grid, cameras and blocks).  The parts' arrays
 * are freed on the way, so that there is about one copy of the entries at any time. */
PVX_MUST_CHECK pvx_err rec_sysmat_merge(rec_sysmat *m, struct rec_entries *part, pvx_pool *pool,
                                        struct rec_entries *out, struct pvx_diag *d);

/* Sets m->win from the blocks, except its arrays and shape. */
void rec_sysmat_window_frame(rec_sysmat *m);
/* Makes m->win from all entries of m.  PVX_ENOMEM; PVX_ERANGE: 2^32 or more windows beyond the columns' own. */
PVX_MUST_CHECK pvx_err rec_sysmat_windows(rec_sysmat *m, const struct rec_entries *e,
                                          pvx_pool *pool);

/* The same, with a message on failure. */
PVX_MUST_CHECK pvx_err rec_sysmat_make_windows(rec_sysmat *m, const struct rec_entries *e,
                                               pvx_pool *pool, struct pvx_diag *d);

/* Sets everything of a coarser level except its entries and footprints. */
void rec_sysmat_coarse_frame(const rec_sysmat *fine, rec_sysmat *coarse);

/* Makes the next coarser level by (4) of sysmat.h.  e: the entries of `fine`; *out: those of the coarser level.  It
 * is exact except for the rounding (3), which here goes along a row in the order of the columns. */
PVX_MUST_CHECK pvx_err rec_sysmat_coarsen(const rec_sysmat *fine, const struct rec_entries *e,
                                          pvx_pool *pool, rec_sysmat **coarse,
                                          struct rec_entries *out, struct pvx_diag *d);
/* Makes the windows of m and of all coarser levels, each in ->coarse of the finer one; takes over m's entries. */
PVX_MUST_CHECK pvx_err rec_sysmat_add_levels(rec_sysmat *m, struct rec_entries *e, pvx_pool *pool,
                                             struct pvx_diag *d);

#endif
