/* sysmat.h - the system matrix S of a rig: built once, cached on disk, memory-mapped (paper (4)).
 *
 *     p = S a,   S = [S_0; S_1; ...; S_{C-1}]   one block of rows per camera           (1)
 *
 * A row of S_c is one bin of camera c: binning x binning raw sensor pixels; its entries are the mean
 * of the ray integrals of rays_per_bin^2 rays spread evenly over the bin (each traced through the
 * distorted lens; no image is ever resampled).  rays_per_bin = 1, binning = 1 is the paper's model.
 * Rows are numbered in one row space: row = row0[c] + y*bw + x, camera by camera.
 *
 * S is stored by COLUMNS, as windows of bins (recon/simd/windows.h), because a voxel's basis function touches a
 * handful of neighbouring bins in a camera.  Reason for columns: restricting S to the visual hull (paper 4.4)
 * keeps a tenth of them, in a few thousand runs that are copied unchanged; the other nine tenths are not touched.
 * Reason for windows: a bin takes one byte, where a row number and a value take six; one copy serves both
 * products; and rows need no numbers of their own.
 *
 * An entry is a byte,
 *     S_ij = unit * val,   unit = diagonal of a voxel / 254                                  (2)
 * (no value exceeds the diagonal, in either basis and on every level).  Along a row, in the order in
 * which its ray meets the voxels, the running sum C is rounded and not the value,
 *     val_k = round(C_k / unit) - round(C_{k-1} / unit),                                     (3)
 * so every value is within one unit and every row's sum within half a unit, 5e-5 of a chord across
 * 64 voxels: rounding moves a little of the ray to a neighbour, but loses nothing.  (Error of the
 * ring flame at 16, 8, 7 and 6 bits: 0.0671, 0.0672, 0.0673, 0.0679.)
 *
 * Coarser levels: S->coarse is S on the grid of half as many voxels (rounded up) of twice the size,
 * with bins of 2 x 2 bins, by Galerkin's rule
 *     A_c = R A P,  P: a voxel's coefficient to its 8 children,  R: mean of a bin's children (4)
 * (at an odd edge of the image of those that it has).  For the box basis that is the matrix of the
 * coarser grid.  It has its own coarse level, until the longest side would be under 16 voxels.
 *
 * Footprint of a column in a camera: the rectangle of bins that the support of basis function j
 * touches (conservative: every bin with a ray through the support is inside it; a support smaller
 * than a bin still has one).  seen = some part of it is in the image; behind or outside = unseen.
 * Rays end at the first body of the rig: voxels behind it have no entries there and are unseen.
 * A camera that blurs (camera.h) has footprints of its middle rays: light in a voxel reaches all of them, so the hull
 * stays conservative, and its entries reach further.
 * On coarser levels a footprint is the union of the children's.
 * Files: little-endian, one version, header and sections with XXH3-64 checksums, key = hash of all
 * that S depends on, all levels in one file.
 * Ownership: the object owns its memory or mapping and its coarser levels; blocks are borrowed. */
#ifndef REC_SYSMAT_H
#define REC_SYSMAT_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "base/pool.h"
#include "recon/geom/rig.h"
#include "recon/simd/windows.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Bins that follow one another in a row of an image and are handled together; a vector over rows has
 * whole blocks. */
#define REC_ROW_BLOCK 8

struct rec_sysmat_params {
    int32_t binning;      /* raw pixels per bin side, 1..64; 0 = auto: the largest power of two that
                             divides every image's width and height and keeps a bin at or below
                             1.1 voxels as seen at the centre of the volume */
    int32_t rays_per_bin; /* rays per bin side, 1..16; 0 = auto: 2, the area of a pixel in fewest
                             rays; 1 is the paper's model */
};
extern const struct rec_sysmat_params rec_sysmat_defaults; /* {0, 0} */

struct rec_rect {
    uint16_t x0, y0, x1, y1; /* bins, inclusive; x0 > x1 = not seen by this camera */
};
static inline bool rec_rect_seen(struct rec_rect r)
{
    return r.x0 <= r.x1;
}

/* Footprints are stored in bricks of 4^3 voxels, x fastest within and between bricks: footprints that are used
 * together lie together.  At the edge of the grid a brick has places without a voxel; those are not seen. */
#define REC_BRICK        4
#define REC_BRICK_VOXELS (REC_BRICK * REC_BRICK * REC_BRICK)

/* The data of one camera. */
struct rec_sysmat_block {
    int32_t bw, bh;            /* bins across and down; rows row0[c] + y*bw + x */
    uint64_t nnz;              /* entries of its rows */
    const struct rec_rect *fp; /* [rec_brick_places] footprints */
};

typedef struct rec_sysmat rec_sysmat;
struct rec_sysmat {
    struct rec_grid grid;
    size_t n_cameras;
    int32_t binning, rays_per_bin; /* resolved, never 0; both double from level to level */
    uint64_t key;
    float unit;                       /* m */
    uint64_t nnz;                     /* entries that are not 0, < 2^32 */
    struct rec_windows win;           /* of all columns; not to be written to */
    struct rec_sysmat_block *block;   /* [n_cameras] */
    size_t row0[REC_MAX_CAMERAS + 1]; /* first row of each camera; [n_cameras] = rows in all */
    rec_sysmat *coarse;               /* or NULL */
    struct rec_active *active;        /* the part that exists (active.h); NULL: all of S */
    bool cached;                      /* rec_sysmat_open found it */
    void *priv;                       /* mapping or heap */
};

static inline int32_t rec_bricks(const struct rec_grid *g, int axis)
{
    return (g->n[axis] + REC_BRICK - 1) / REC_BRICK;
}
static inline size_t rec_brick_places(const struct rec_grid *g)
{
    return (size_t)rec_bricks(g, 0) * (size_t)rec_bricks(g, 1) * (size_t)rec_bricks(g, 2) *
           REC_BRICK_VOXELS;
}
/* Place of the footprint of voxel (i,j,k). */
static inline size_t rec_brick_place(const struct rec_grid *g, int32_t i, int32_t j, int32_t k)
{
    size_t row = (size_t)(k / REC_BRICK) * (size_t)rec_bricks(g, 1) + (size_t)(j / REC_BRICK);
    size_t brick = row * (size_t)rec_bricks(g, 0) + (size_t)(i / REC_BRICK);
    return brick * REC_BRICK_VOXELS +
           (size_t)((k % REC_BRICK * REC_BRICK + j % REC_BRICK) * REC_BRICK + i % REC_BRICK);
}
/* Footprint of a voxel in camera c. */
static inline struct rec_rect rec_footprint(const rec_sysmat *m, size_t c, int32_t voxel)
{
    int32_t ijk[3];
    rec_grid_ijk(&m->grid, voxel, ijk);
    return m->block[c].fp[rec_brick_place(&m->grid, ijk[0], ijk[1], ijk[2])];
}

/* Progress of long work: called from the calling thread only, `done` in 0..1; return false to
 * cancel (the build then gives PVX_ECANCELED and leaves nothing behind).  May be NULL. */
typedef bool (*rec_progress_fn)(void *ctx, double done);

struct rec_progress {
    rec_progress_fn call;
    void *ctx;
};

/* Resolve the autos of `p` for this rig into *out.  PVX_EINVAL + diag when a bin size does not
 * divide an image. */
PVX_MUST_CHECK pvx_err rec_sysmat_resolve(const struct rec_rig *rig,
                                          const struct rec_sysmat_params *p,
                                          struct rec_sysmat_params *out, struct pvx_diag *d);

/* Key of the matrix that rig + params give (params resolved inside). */
PVX_MUST_CHECK pvx_err rec_sysmat_key(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                                      uint64_t *key, struct pvx_diag *d);

/* Build in memory with all coarser levels, in parallel over row bands; same bits for any number of
 * threads.  Errors: PVX_EINVAL, PVX_ENOMEM (diag: how much), PVX_ERANGE (over 2^32-1 entries or
 * 2^31-1 rows), PVX_ECANCELED.  Cost: O(rays * (nx+ny+nz)). */
PVX_MUST_CHECK pvx_err rec_sysmat_build(const struct rec_rig *rig,
                                        const struct rec_sysmat_params *p, pvx_pool *pool,
                                        rec_progress_fn progress, void *ctx, rec_sysmat **out,
                                        struct pvx_diag *d);
void rec_sysmat_free(rec_sysmat **m);
/* To be called after all of a mapped matrix was read.  Its pages leave the process, but stay in the file cache; pages
 * that are used again come back. */
void rec_sysmat_let_go(const rec_sysmat *m);

/* Grid of (4). */
void rec_sysmat_coarse_grid(const struct rec_grid *fine, struct rec_grid *coarse);
/* Number of levels of a matrix on this grid, itself included. */
size_t rec_sysmat_levels(const struct rec_grid *g);

/* Write / map.  save is atomic (temporary + rename) and reports a full disk as PVX_ENOSPC.
 * load checks magic, version, header checksum and sizes against the file's length, and with
 * verify=true also the sections' checksums and every index range, in parallel; `key` 0 = any.
 * Errors: PVX_ENOENT, PVX_EFORMAT, PVX_EVERSION, PVX_ECORRUPT, PVX_ESTALE (key differs). */
PVX_MUST_CHECK pvx_err rec_sysmat_save(const rec_sysmat *m, const char *path, pvx_pool *pool,
                                       struct pvx_diag *d);
PVX_MUST_CHECK pvx_err rec_sysmat_load(const char *path, uint64_t key, bool verify, pvx_pool *pool,
                                       rec_sysmat **out, struct pvx_diag *d);

/* The cached matrix if it exists, is sound and belongs to this rig; otherwise builds and caches it.  `path` NULL =
 * $PYROVOX_CACHE or $XDG_CACHE_HOME/pyrovox or ~/.cache/pyrovox, file sysmat-<key>.pvxm; there the files used last are
 * kept, of at most $PYROVOX_CACHE_MAX GB (default 5).  A damaged or stale file is
 * logged and rebuilt (but a file given by `path` that never was a matrix is not overwritten: PVX_EFORMAT).  If the
 * cache cannot be written, that is logged and the matrix is used from memory. */
PVX_MUST_CHECK pvx_err rec_sysmat_open(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                                       const char *path, pvx_pool *pool,
                                       struct rec_progress progress, rec_sysmat **out,
                                       struct pvx_diag *d);

#ifdef __cplusplus
}
#endif
#endif
