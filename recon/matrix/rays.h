/* rays.h - rows of S: the rays of a bin walked, each to the first body of the rig, and its entries rounded
 * (sysmat.h (3)).  Not for other modules.
 * Threads: a rec_tracer is read only while its camera is traced, but for `depth`, of which each bin is written by
 * the thread that traces it.  A rec_rays belongs to one thread at a time. */
#ifndef REC_RAYS_H
#define REC_RAYS_H
#include "recon/matrix/store.h"

/* One camera's rays, on the grid of the finest level. */
struct rec_tracer {
    const struct rec_rig *rig;
    const struct rec_camera *c;
    int32_t binning, rays, bw;
    double per_unit; /* 1 / unit of the matrix */
    size_t bin_max;  /* entries of a bin, at most */
    float *depth;    /* [bins] m to the nearest body, or NULL: no bodies */
};
/* But for camera and depth. */
void rec_tracer_init(struct rec_tracer *t, const struct rec_rig *rig,
                     const struct rec_sysmat_params *p);

/* What walking a bin needs. */
struct rec_rays {
    int32_t *index; /* of one ray */
    float *value;
    /* Merging the rays of a bin: open addressing by voxel, emptied by starting a new epoch. */
    struct rec_ray_slot {
        int32_t index;
        uint32_t epoch;
        double sum;
    } * slot;
    uint32_t *order; /* slots in the order of their first ray */
    uint32_t epoch;
    unsigned slot_bits;
};
PVX_MUST_CHECK pvx_err rec_rays_new(const struct rec_tracer *t, struct rec_rays *out);
void rec_rays_free(struct rec_rays *r); /* zeroed content is fine */

/* Entries of bin (x,y) into col, val [bin_max], in the order in which its rays meet them; how many. */
size_t rec_rays_bin(const struct rec_tracer *t, struct rec_rays *r, int32_t x, int32_t y,
                    uint32_t *col, uint8_t *val);

/* Where bodies end the rays of each bin, without walking them.  t->depth [bw*bh] out. */
void rec_rays_depth(const struct rec_tracer *t, int32_t bh, pvx_pool *pool);
/* [rows] of no body, into *out; NULL stays where the rig has none.  False: out of memory. */
bool rec_rays_new_depth(const struct rec_rig *rig, size_t rows, float **out);

#endif
