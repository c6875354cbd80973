/* hull.h - visual hull: the coefficients that may be non-zero at all (paper 4.4).
 *
 *     H = { j : |{c sees j}| >= min_views and for every present camera c that sees j:
 *               the footprint of j in c has a lit bin }                                   (1)
 * A footprint that reaches the edge of the image may continue outside: if it is dark, it neither drops the
 * voxel nor counts as a view.  A camera does not see a voxel that a body of the rig hides from it, and never
 * drops one that a body hides in part.  So with exact images no voxel with light in it is ever dropped.
 * inside = every bin of every footprint is lit; partial = kept by (1) but not inside; outside = the
 * rest.  keep_partial = 0 keeps inside only (the strict rule).
 * Source: A. Laurentini, IEEE TPAMI 16(2):150-162, 1994, on footprints instead of points.
 * Method: summed-area table of each silhouette (4 look-ups per footprint).  Bricks of 4^3 voxels
 * are tested first, so empty space costs next to nothing; voxels are tested only where the brick is undecided.
 * Threads: one carve per rec_hull at a time; parallel inside over bands of pictures, rows of
 * bricks and layers of voxels.  Allocates nothing. */
#ifndef REC_HULL_H
#define REC_HULL_H
#include "base/pool.h"
#include "recon/matrix/sysmat.h"

#ifdef __cplusplus
extern "C" {
#endif

struct rec_hull_params {
    uint32_t min_views; /* default 2 */
    int keep_partial;   /* default 1: conservative */
};
#define REC_HULL_DEFAULTS                 \
    {                                     \
        .min_views = 2, .keep_partial = 1 \
    }

struct rec_hull_counts {
    int64_t inside, partial, outside;
    int64_t cut; /* bricks that may contain more of the hull but that S does not keep (active.h) */
};

typedef struct rec_hull rec_hull;

/* Borrows S.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_hull_new(const rec_sysmat *S, rec_hull **out);
void rec_hull_free(rec_hull **h);

struct rec_hull_kept {
    int32_t *col;   /* [n], room for [N]: kept voxels, ascending */
    uint8_t *klass; /* [N] or NULL: 0 outside, 1 partial, 2 inside */
    int32_t n;
    struct rec_hull_counts counts;
};
/* lit[c] [bh*bw] silhouettes, 0/1; present[c] false: camera c neither carves nor counts. */
void rec_hull_carve(rec_hull *h, const struct rec_hull_params *p, const uint8_t *const *lit,
                    const bool *present, pvx_pool *pool, struct rec_hull_kept *out);

#ifdef __cplusplus
}
#endif
#endif
