/* active.h - the part of S where a recording's flame can be: for grids whose whole S would not fit into memory.
 *
 *   1. rec_sysmat_outline: a matrix that has only footprints of bricks (4^3 voxels; sysmat.h), made from the lenses
 *   2. rec_hull_bricks (recon/carve/hull_bricks.h), set after set: the bricks that its silhouettes leave are marked
 *   3. rec_sysmat_build_active: S with the columns of the marked bricks' voxels
 * So a set's hull lies inside the marked part if its silhouettes were seen in 2.  A hull that reaches beyond the
 * marked part is cut there, and its count in rec_hull_counts shows it.
 *
 * The columns have the bits of the whole S.  Rays are walked through all of the grid and rounded along their whole
 * row, and coarser levels are made of all entries of a row ((3) and (4) of sysmat.h).  Only then the entries that are
 * not kept are dropped; the entries of the whole S never exist at the same time.  A coarser level keeps the bricks
 * that have a kept one among their children.  The coarsest level keeps all, because the vote solves on all of it.
 * The shape of the windows is chosen by the kept entries.
 * Columns that are not kept have no memory: their places are reserved address space and must not be read.
 * Such a matrix is not saved: it belongs to this recording, but the whole S has the same key. */
#ifndef REC_ACTIVE_H
#define REC_ACTIVE_H
#include "recon/matrix/sysmat.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The footprint of a brick if not all of its voxels need be seen, or are known to be.  It does not carve the brick,
 * and may be a view of some of its voxels.  As a rec_rect it is not seen. */
#define REC_RECT_UNKNOWN ((struct rec_rect){2, 2, 0, 0})
static inline bool rec_rect_unknown(struct rec_rect r)
{
    return r.x0 == 2 && r.x1 == 0;
}

struct rec_active {
    size_t bricks, marked;
    uint8_t *brick; /* [bricks] 1 = marked */
    /* [bricks] per camera: rectangle around the footprints of its voxels; finest level only */
    struct rec_rect *rect[REC_MAX_CAMERAS];

    /* set once the columns are known: */
    size_t columns;   /* kept */
    uint64_t *bits;   /* bit v % 64 of word v / 64: voxel v is kept */
    uint32_t *rank;   /* kept voxels before each word */
    uint32_t *column; /* [columns] their voxels, ascending */
};

static inline bool rec_active_has(const struct rec_active *a, size_t voxel)
{
    return (a->bits[voxel / 64] >> voxel % 64 & 1) != 0;
}
/* Index of a kept voxel among the kept ones. */
static inline uint32_t rec_active_rank(const struct rec_active *a, size_t voxel)
{
    uint64_t before = a->bits[voxel / 64] & (((uint64_t)1 << voxel % 64) - 1);
    return a->rank[voxel / 64] + (uint32_t)__builtin_popcountll(before);
}

/* Makes an outline: no brick marked, no windows, no coarser levels.  Errors: as rec_sysmat_build; may be canceled
 * between two cameras. */
PVX_MUST_CHECK pvx_err rec_sysmat_outline(const struct rec_rig *rig,
                                          const struct rec_sysmat_params *p, pvx_pool *pool,
                                          struct rec_progress progress, rec_sysmat **out,
                                          struct pvx_diag *d);

/* The estimated cost of rec_sysmat_build_active.  It is measured by tracing a share of the rows of bins, evenly
 * spread over those of each camera, in the same way as a build. */
struct rec_active_estimate {
    double share;         /* share of the rows of bins that was traced */
    double seconds;       /* to trace all rows with this pool's threads */
    double entries;       /* entries of all columns, as in the whole S */
    double kept;          /* entries of the kept columns, all levels */
    size_t columns, bins; /* kept on the finest level; bins of all cameras */
    size_t window;        /* weights of a window, at most */
    uint64_t stored;   /* bytes of the matrix, at most: windows of the largest shape, whole pages */
    uint64_t building; /* bytes while building, at most, the matrix included */
};
/* The estimate for the bricks that are marked in the outline, which stays as it is.  share in (0,1]: at least this
 * share of each camera's rows is traced, and at least eight bands of them.  Errors: as rec_sysmat_build_active. */
PVX_MUST_CHECK pvx_err rec_sysmat_estimate_active(const struct rec_rig *rig,
                                                  const rec_sysmat *outline, double share,
                                                  pvx_pool *pool, struct rec_progress progress,
                                                  struct rec_active_estimate *out,
                                                  struct pvx_diag *d);

/* About the bytes of the whole matrix while it is built: 2x2 or 3x4 windows and 5.4 entries a voxel and camera
 * (NUMERICS.md, 16). */
double rec_sysmat_whole(const struct rec_rig *rig, const struct rec_sysmat_params *resolved);

/* As rec_sysmat_build, where the limit of 2^32-1 entries applies to the kept ones.  Takes over the outline with its
 * marks; *outline becomes NULL. */
PVX_MUST_CHECK pvx_err rec_sysmat_build_active(const struct rec_rig *rig, rec_sysmat **outline,
                                               pvx_pool *pool, struct rec_progress progress,
                                               rec_sysmat **out, struct pvx_diag *d);

#ifdef __cplusplus
}
#endif
#endif
