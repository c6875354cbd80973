/* sysmat.h - the system matrix S of a rig: built once, cached on disk, memory-mapped (paper (4)).
 *
 *     p = S a,   S = [S_0; S_1; ...; S_{C-1}]   one block of rows per camera           (1)
 *
 * A row of S_c is one bin of camera c: binning x binning raw sensor pixels; its entries are the mean
 * of the ray integrals of rays_per_bin^2 rays spread evenly over the bin (each traced through the
 * distorted lens; no image is ever resampled).  rays_per_bin = 1, binning = 1 is the paper's model.
 *
 * Each block is stored by COLUMNS: for voxel j the entries [colptr[j], colptr[j+1]) with rows
 * ascending.  Why: restricting S to the visual hull (paper 4.4) keeps a tenth of the columns and all
 * their entries, so what a frame set needs is found by looking at its columns alone; nothing of the
 * other nine tenths is read.  Blocks per camera: a camera that is missing is a block left out.
 *
 * Footprint of a column in a camera: the rectangle of bins that the support of basis function j
 * touches (conservative: every bin with a ray through the support is inside it; a support smaller
 * than a bin still has one).  seen = some part of it is in the image; behind or outside = unseen.
 * Files: little-endian, one version, header and sections with XXH3-64 checksums, key = hash of all
 * that S depends on.
 * Ownership: the object owns its memory or mapping; blocks are borrowed views. */
#ifndef REC_SYSMAT_H
#define REC_SYSMAT_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "base/pool.h"
#include "recon/rig.h"

struct rec_sysmat_params {
    int32_t binning;      /* raw pixels per bin side, 1..64; 0 = auto: the largest power of two that
                             divides every image's width and height and keeps a bin at or below
                             1.1 voxels as seen at the centre of the volume */
    int32_t rays_per_bin; /* rays per bin side, 1..16; 0 = auto: 1 where binning is 1, else 2 */
};
extern const struct rec_sysmat_params rec_sysmat_defaults; /* {0, 0} */

struct rec_rect {
    uint16_t x0, y0, x1, y1; /* bins, inclusive; x0 > x1 = not seen by this camera */
};
static inline bool rec_rect_seen(struct rec_rect r)
{
    return r.x0 <= r.x1;
}

struct rec_sysmat_block {
    int32_t bw, bh; /* bins across and down; rows = bw*bh, row = y*bw + x */
    uint64_t nnz;
    const uint32_t *colptr;    /* [N+1] */
    const uint32_t *row;       /* [nnz] 0..bw*bh-1 */
    const float *val;          /* [nnz] m, > 0 */
    const struct rec_rect *fp; /* [N] footprints */
};

typedef struct rec_sysmat {
    struct rec_grid grid;
    size_t n_cameras;
    int32_t binning, rays_per_bin; /* resolved, never 0 */
    uint64_t key;
    uint64_t nnz;                   /* sum over blocks */
    struct rec_sysmat_block *block; /* [n_cameras] */
    void *priv;                     /* mapping or heap */
} rec_sysmat;

/* Progress of long work: called from the calling thread only, `done` in 0..1; return false to
 * cancel (the build then gives PVX_ECANCELED and leaves nothing behind).  May be NULL. */
typedef bool (*rec_progress_fn)(void *ctx, double done);

/* Resolve the autos of `p` for this rig into *out.  PVX_EINVAL + diag when a bin size does not
 * divide an image. */
PVX_MUST_CHECK pvx_err rec_sysmat_resolve(const struct rec_rig *rig,
                                          const struct rec_sysmat_params *p,
                                          struct rec_sysmat_params *out, struct pvx_diag *d);

/* Key of the matrix that rig + params give (params resolved inside). */
PVX_MUST_CHECK pvx_err rec_sysmat_key(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                                      uint64_t *key, struct pvx_diag *d);

/* Build in memory, in parallel over cameras and row bands; same bits for any number of threads.
 * Errors: PVX_EINVAL, PVX_ENOMEM (diag: how much), PVX_ERANGE (a block over 2^32-1 entries),
 * PVX_ECANCELED.  Cost: O(rays * (nx+ny+nz)), twice. */
PVX_MUST_CHECK pvx_err rec_sysmat_build(const struct rec_rig *rig,
                                        const struct rec_sysmat_params *p, pvx_pool *pool,
                                        rec_progress_fn progress, void *ctx, rec_sysmat **out,
                                        struct pvx_diag *d);
void rec_sysmat_free(rec_sysmat **m);

/* Write / map.  save is atomic (temporary + rename) and reports a full disk as PVX_ENOSPC.
 * load checks magic, version, header checksum and sizes against the file's length, and with
 * verify=true also the sections' checksums and every index range; `key` 0 = any.  Errors: PVX_ENOENT, PVX_EFORMAT, PVX_EVERSION, PVX_ECORRUPT,
 * PVX_ESTALE (key differs). */
PVX_MUST_CHECK pvx_err rec_sysmat_save(const rec_sysmat *m, const char *path, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err rec_sysmat_load(const char *path, uint64_t key, bool verify,
                                       rec_sysmat **out, struct pvx_diag *d);

/* What a user wants: the cached matrix if it is there, sound and of this rig, else build and cache.
 * `path` NULL = $PYROVOX_CACHE or $XDG_CACHE_HOME/pyrovox or ~/.cache/pyrovox, file
 * sysmat-<key>.pvxm.  A damaged or stale file is logged and rebuilt (but a file given by `path` that
 * never was a matrix is not overwritten: PVX_EFORMAT); a cache that cannot be written is logged and
 * the matrix used from memory.  *from_cache may be NULL. */
PVX_MUST_CHECK pvx_err rec_sysmat_open(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                                       const char *path, pvx_pool *pool, rec_progress_fn progress,
                                       void *ctx, rec_sysmat **out, bool *from_cache,
                                       struct pvx_diag *d);

#endif
