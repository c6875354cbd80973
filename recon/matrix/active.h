/* active.h - S of the part of a grid where a recording's flame can be: for grids whose whole S would not fit.
 *
 *   1. rec_sysmat_outline: a matrix of footprints of bricks alone (4^3 voxels; sysmat.h), from the lenses
 *   2. rec_hull_bricks (recon/carve/hull.h), set after set: those that its silhouettes leave are marked
 *   3. rec_sysmat_build_active: S with the columns of the marked bricks' voxels
 * So a set's hull lies inside the marked part if its silhouettes were seen in 2; one that does not is cut there, and
 * its count in rec_hull_counts says so.
 *
 * The columns have the bits of the whole S: rays are walked through all of the grid and rounded along all of their
 * row, coarser levels are made of all entries of a row, (3) and (4) of sysmat.h, and only then what is not kept is
 * dropped; the entries of the whole are never there at once.  Of a coarser level the bricks are kept that
 * have a kept one among their children, of the coarsest all: the vote solves on all of it.  The shape of the windows
 * is chosen by what is kept.
 * Columns that are not kept have no memory: their places are reserved address space and must not be read.
 * Such a matrix is not saved: it is of this recording, and the whole one has the same key. */
#ifndef REC_ACTIVE_H
#define REC_ACTIVE_H
#include "recon/matrix/sysmat.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What a brick's footprint is where not all of its voxels need be seen, or are known to be: it does not carve it, and may
 * be a view of some of it.  As a rec_rect it is not seen. */
#define REC_RECT_UNKNOWN ((struct rec_rect){2, 2, 0, 0})
static inline bool rec_rect_unknown(struct rec_rect r)
{
    return r.x0 == 2 && r.x1 == 0;
}

struct rec_active {
    size_t bricks, marked;
    uint8_t *brick; /* [bricks] 1 = marked */
    /* [bricks] of each camera: its voxels' footprints and what is between them; finest level only */
    struct rec_rect *rect[REC_MAX_CAMERAS];

    /* once there are columns: */
    size_t columns;   /* kept */
    uint64_t *bits;   /* bit v % 64 of word v / 64: voxel v is kept */
    uint32_t *rank;   /* kept ones before each word */
    uint32_t *column; /* [columns] their voxels, ascending */
};

static inline bool rec_active_has(const struct rec_active *a, size_t voxel)
{
    return (a->bits[voxel / 64] >> voxel % 64 & 1) != 0;
}
/* Number of a kept voxel among them. */
static inline uint32_t rec_active_rank(const struct rec_active *a, size_t voxel)
{
    uint64_t before = a->bits[voxel / 64] & (((uint64_t)1 << voxel % 64) - 1);
    return a->rank[voxel / 64] + (uint32_t)__builtin_popcountll(before);
}

/* No brick marked, no windows, no coarser levels.  Errors: as rec_sysmat_build, canceled between two cameras. */
PVX_MUST_CHECK pvx_err rec_sysmat_outline(const struct rec_rig *rig,
                                          const struct rec_sysmat_params *p, pvx_pool *pool,
                                          struct rec_progress progress, rec_sysmat **out,
                                          struct pvx_diag *d);

/* What building it would take, from a share of the rows of bins, evenly spread over each camera's, that are traced as
 * they would be. */
struct rec_active_estimate {
    double share;         /* of the rows of bins that was traced */
    double seconds;       /* to trace all rows with this pool's threads */
    double entries;       /* of all columns: what a whole S would have */
    double kept;          /* of those kept, all levels */
    size_t columns, bins; /* kept on the finest level; of all cameras */
    size_t window;        /* weights of one, at most */
    uint64_t stored;   /* bytes of what stays, at most: windows of the largest shape, whole pages */
    uint64_t building; /* bytes at most, what stays included */
};
/* Of the bricks that the outline has marked, which it leaves as they are.  share in (0,1]: as much of each camera's rows
 * at least, and eight bands of them.  Errors: as rec_sysmat_build_active. */
PVX_MUST_CHECK pvx_err rec_sysmat_estimate_active(const struct rec_rig *rig,
                                                  const rec_sysmat *outline, double share,
                                                  pvx_pool *pool, struct rec_progress progress,
                                                  struct rec_active_estimate *out,
                                                  struct pvx_diag *d);

/* As rec_sysmat_build, which is 2^32-1 entries of what is kept at most.  Takes the outline's marks, and frees it. */
PVX_MUST_CHECK pvx_err rec_sysmat_build_active(const struct rec_rig *rig, rec_sysmat **outline,
                                               pvx_pool *pool, struct rec_progress progress,
                                               rec_sysmat **out, struct pvx_diag *d);

#ifdef __cplusplus
}
#endif
#endif
