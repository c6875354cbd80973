/* priv.h - what the files of sysmat.h share: where a matrix's memory is, and the parts of its
 * construction.  Not for other modules. */
#ifndef REC_SYSMAT_PRIV_H
#define REC_SYSMAT_PRIV_H
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

/* A level while S is built, by columns: the entries of column j are [colptr[j],colptr[j+1]), rows
 * ascending, values > 0 in units.  Of one camera: its own columns, rows without row0.  Of a part of S the columns
 * are those kept. */
struct rec_entries {
    uint32_t *colptr; /* [columns+1] */
    uint32_t *row;
    uint8_t *val;
    uint64_t nnz;
    float *depth; /* of one camera, or NULL: m to the nearest body in a bin */
};
void rec_entries_free(struct rec_entries *e);

/* An empty matrix with `n_cameras` blocks, all arrays NULL.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_alloc(size_t n_cameras, rec_sysmat **out);

/* row0 from the blocks' bw, bh.  PVX_ERANGE + diag: more than 2^31-1 rows. */
PVX_MUST_CHECK pvx_err rec_sysmat_number_rows(rec_sysmat *m, struct pvx_diag *d);

/* `bytes` from the heap, aligned but not zeroed.  free(); NULL when there are none. */
void *rec_sysmat_array(uint64_t bytes);

/* Columns that there are, N or those kept. */
size_t rec_sysmat_columns(const rec_sysmat *m);
static inline size_t rec_sysmat_voxel(const rec_sysmat *m, size_t column)
{
    return m->active != NULL ? m->active->column[column] : column;
}

/* Address space of a level that keeps a part. */
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

/* No brick marked; the marks' columns; those of a coarser grid.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_active_new(const struct rec_grid *g, struct rec_active **out);
PVX_MUST_CHECK pvx_err rec_active_close(struct rec_active *a, const struct rec_grid *g);
PVX_MUST_CHECK pvx_err rec_active_coarser(const struct rec_active *a, const struct rec_grid *g,
                                          const struct rec_grid *coarse, struct rec_active **out);
void rec_active_free(struct rec_active **a);

/* Address space of which pages are touched here and there: small ones.  pvx_unreserve(). */
void *rec_sysmat_sparse(size_t bytes);

/* Everything of the finest level but its entries and footprints, and rows.  p is resolved. */
PVX_MUST_CHECK pvx_err rec_sysmat_finest_frame(const struct rec_rig *rig,
                                               const struct rec_sysmat_params *p, rec_sysmat *m,
                                               struct pvx_diag *d);
/* Everything of a coarser level but its entries and footprints. */
void rec_sysmat_coarse_frame(const rec_sysmat *fine, rec_sysmat *coarse);

/* (2) for a grid; twice the finer grid's, exactly, on a coarser one. */
float rec_sysmat_unit(const struct rec_grid *g);

/* The cameras' parts, end to end within each column (m: grid, cameras and blocks set); the parts'
 * arrays are freed on the way, so that there is about one copy of the entries at any time. */
PVX_MUST_CHECK pvx_err rec_sysmat_merge(rec_sysmat *m, struct rec_entries *part, pvx_pool *pool,
                                        struct rec_entries *out, struct pvx_diag *d);

/* m->win but its arrays and shape, from the blocks. */
void rec_sysmat_window_frame(rec_sysmat *m);
/* m->win from all entries of m.  PVX_ENOMEM; PVX_ERANGE: 2^32 windows or more do not fit theirs. */
PVX_MUST_CHECK pvx_err rec_sysmat_windows(rec_sysmat *m, const struct rec_entries *e,
                                          pvx_pool *pool);

/* The same, and what there is to say when it has none. */
PVX_MUST_CHECK pvx_err rec_sysmat_make_windows(rec_sysmat *m, const struct rec_entries *e,
                                               pvx_pool *pool, struct pvx_diag *d);

/* (4) of sysmat.h: the level below `fine`, whose entries these are; the coarser one's into *out.
 * Exact but for the rounding (3), which here goes along a row in the order of the columns. */
PVX_MUST_CHECK pvx_err rec_sysmat_coarsen(const rec_sysmat *fine, const struct rec_entries *e,
                                          pvx_pool *pool, rec_sysmat **coarse,
                                          struct rec_entries *out, struct pvx_diag *d);
/* Windows of m and all coarser levels, each into ->coarse of the finer one; takes m's entries. */
PVX_MUST_CHECK pvx_err rec_sysmat_add_levels(rec_sysmat *m, struct rec_entries *e, pvx_pool *pool,
                                             struct pvx_diag *d);

/* All of them unseen, and what is no voxel's for good. */
void rec_no_footprints(const rec_sysmat *m, struct rec_rect *fp);
/* Footprints of all columns of camera c from its lens, widened to every entry that is there.
 * A support that is partly behind a body is like one that is partly behind the camera: where it has entries its
 * footprint is the whole image, which never carves, else it is unseen.
 * fp [rec_brick_places] out.  Parallel over slabs of voxels, same bits for any thread count.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_footprints(const rec_sysmat *m, const struct rec_camera *c,
                                             const struct rec_sysmat_block *b,
                                             const struct rec_entries *part, pvx_pool *pool,
                                             struct rec_rect *fp);

/* Those of whole bricks in camera c, as far as they are known without entries, into brick [bricks]: projected as one
 * support each, which holds those of its voxels and may be larger by what a lens bends along a brick; depth as in
 * rec_entries.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_brick_footprints(const rec_sysmat *m, const struct rec_camera *c,
                                                   const struct rec_sysmat_block *b, float *depth,
                                                   pvx_pool *pool, struct rec_rect *brick);

/* Those of camera c on all levels of m, which keep a part each, into their blocks.  part: the finest's; met [N bits]
 * which of its columns have entries at all.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_sysmat_active_footprints(const rec_sysmat *m, size_t c,
                                                    const struct rec_camera *camera,
                                                    const struct rec_entries *part,
                                                    const _Atomic uint64_t *met, pvx_pool *pool);
#endif
