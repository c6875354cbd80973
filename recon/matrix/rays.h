/* rays.h - rows of S: walks the rays of a bin, each to the first body of the rig, and rounds its entries (sysmat.h
 * (3)).  Not for other modules.
 * Threads: while its camera is traced, a rec_tracer is only read, except `depth`: the thread that traces a bin writes
 * its depth.  A rec_rays belongs to one thread at a time. */
#ifndef REC_RAYS_H
#define REC_RAYS_H
#include "recon/geom/bundle.h"
#include "recon/matrix/store.h"

/* One camera's rays, on the grid of the finest level. */
struct rec_tracer {
    const struct rec_rig *rig;
    struct rec_bundle bundle; /* of the camera */
    int32_t binning, rays, bw;
    int32_t most;    /* rays of a bin of any camera, at most */
    double per_unit; /* 1 / unit of the matrix */
    size_t bin_max;  /* entries of a bin of any camera, at most */
    float *depth;    /* [bins] m to the nearest body, or NULL: no bodies */
};
/* Sets all that does not depend on the camera. */
void rec_tracer_init(struct rec_tracer *t, const struct rec_rig *rig,
                     const struct rec_sysmat_params *p);
/* The rays of camera c, which has bins in rows of bw. */
void rec_tracer_camera(struct rec_tracer *t, size_t c, int32_t bw);

/* Work area for walking a bin. */
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

/* Writes entries of bin (x,y) to col, val [bin_max], in the order in which its rays meet them; returns how many. */
size_t rec_rays_bin(const struct rec_tracer *t, struct rec_rays *r, int32_t x, int32_t y,
                    uint32_t *col, uint8_t *val);

/* Finds where bodies end the rays of each bin, without walking them.  t->depth [bw*bh] out. */
void rec_rays_depth(const struct rec_tracer *t, int32_t bh, pvx_pool *pool);
/* Allocates *out [rows], set to "no body"; NULL if the rig has no bodies.  False: out of memory. */
bool rec_rays_new_depth(const struct rec_rig *rig, size_t rows, float **out);

#endif
