/* build_active.h - shared by the files that build a part of S (active.h).  Not for other modules.
 *   active_rows.c      one row of bins after the other, on all levels: stores the kept entries
 *   build_active.c     cameras, levels
 *   estimate_active.c  a share of the rows, and from it the cost of all */
#ifndef REC_BUILD_ACTIVE_H
#define REC_BUILD_ACTIVE_H
#include <pthread.h>
#include <stdatomic.h>

#include "recon/matrix/columns.h"
#include "recon/matrix/rays.h"

/* Two rows of bins, with all their entries. */
struct rec_row_pair {
    struct rec_band all;
    size_t *end;   /* [2*bw] end of the entries of each bin */
    size_t second; /* where the second row's entries begin */
};

/* Column and exact value in eighths of the coarse unit. */
struct rec_coarse_sum {
    uint32_t col, eighths;
};

/* Memory of one running task; there are as many as threads. */
struct rec_active_scratch {
    atomic_flag in_use;
    struct rec_rays rays;
    struct rec_row_pair pair[REC_SYSMAT_LEVELS_MAX];
    struct rec_coarse_sum *table, *list,
        *sorted; /* [room] hash table with open addressing; its content; room to sort it */
    size_t room;
};

struct rec_active_level {
    rec_sysmat *m;
    struct rec_band_rows rows; /* of the camera in work */
    struct rec_entries part[REC_MAX_CAMERAS];
    uint32_t *
        coarse_row; /* [ny*nz] per row of voxels: first column of the coarser row that contains it */
    double per_nx;
};

struct rec_active_build {
    const struct rec_rig *rig;
    size_t levels;
    struct rec_active_level level[REC_SYSMAT_LEVELS_MAX];
    struct rec_tracer t; /* of the camera in work */
    struct rec_active_scratch *scratch;
    size_t n_scratch;
    _Atomic uint64_t *met; /* [voxels] bits: the voxel has entries of the camera */
    size_t camera;
    size_t of; /* every of-th band is traced, and entries are counted; 0: all bands, no counts */
    atomic_uint_fast64_t entries, row_most;
    /* progress */
    pthread_t caller;
    struct rec_progress progress;
    atomic_int rows_done;
    atomic_bool canceled, out_of_memory;
};

static inline int32_t rec_bins_across(const struct rec_active_build *b, size_t l)
{
    return b->level[l].m->block[b->camera].bw;
}
static inline int32_t rec_bins_down(const struct rec_active_build *b, size_t l)
{
    return b->level[l].m->block[b->camera].bh;
}

/* Traces row y of bins of the camera in work, makes the coarser rows that it completes, and stores their kept entries
 * in the band.  Rows of a band ascend.  False: out of memory. */
bool rec_active_row(struct rec_active_build *b, struct rec_active_scratch *s, size_t band,
                    int32_t y);

/* The outline of the finest level stays the caller's.  *out must be freed after an error too. */
PVX_MUST_CHECK pvx_err rec_active_build_new(struct rec_active_build **out,
                                            const struct rec_rig *rig, rec_sysmat *finest,
                                            size_t threads, struct rec_progress progress);
void rec_active_build_free(struct rec_active_build **b);

/* For camera b->camera, in this order: make its tracer and rows; cut them into bands; trace the entries of all bands
 * or of every b->of-th; free the memory of the camera.  PVX_ENOMEM; PVX_ECANCELED. */
PVX_MUST_CHECK pvx_err rec_active_begin(struct rec_active_build *b);
void rec_active_cut(struct rec_active_build *b);
PVX_MUST_CHECK pvx_err rec_active_trace(struct rec_active_build *b, pvx_pool *pool);
void rec_active_end(struct rec_active_build *b);

#endif
