/* unseen.h - what a camera should see according to all others: its view of the volume in which it had no part.
 *
 *     p_c = S_c argmin_x || A_others x - b_others ||,   x >= 0 in the hull of the others            (1)
 *
 * The stages are those of a frame set (recon/frame), on a small grid of its own and in one channel, the mean of a
 * pixel's channels.  Silhouettes are grown by a margin, since with a slightly wrong rig the hull would cut the flame.
 * Memory: S of the small grid, a slot and some pictures.  Cost: (1) a solve of the small grid; a picture one product.
 * Threads: one call at a time, parallel inside; same bits for any number of threads.  After new, only
 * rec_frame_solve allocates.  Owner: caller; pool is borrowed. */
#ifndef REC_UNSEEN_H
#define REC_UNSEEN_H
#include "recon/frame/frame.h"
#include "recon/matrix/subsys.h"

struct rec_unseen_params {
    int32_t voxels; /* along the longest side of the rig's box */
    int32_t across; /* bins across a picture, at least, where it has them */
    int32_t
        binning;    /* 0 = the largest power of two with that many bins that divides all pictures */
    int32_t rays;   /* per bin side */
    int32_t margin; /* bins */
    bool at_least;  /* saturated pixels are lower bounds, else left out (frame.h) */
    bool temporal;  /* volumes use the one before as a prior (frame.h), see rec_unseen_forget */
};
#define REC_UNSEEN_DEFAULTS                                               \
    {                                                                     \
        .voxels = 48, .across = 160, .binning = 0, .rays = 2, .margin = 1 \
    }

typedef struct rec_unseen rec_unseen;

/* Errors: PVX_EINVAL, PVX_ENOMEM and those of rec_sysmat_build. */
PVX_MUST_CHECK pvx_err rec_unseen_new(const struct rec_rig *rig, const struct rec_unseen_params *p,
                                      pvx_pool *pool, rec_unseen **out, struct pvx_diag *d);
void rec_unseen_free(rec_unseen **u);
/* The binning that `p` gives this rig. */
int32_t rec_unseen_binning(const struct rec_rig *rig, const struct rec_unseen_params *p);
/* Bins of its pictures, and its grid. */
const rec_sysmat *rec_unseen_matrix(const rec_unseen *u);

/* The set's pictures [bh][bw], linear, one channel; NULL = missing.  Photometry runs on all.
 * floats: they have no full scale (frame.h). */
void rec_unseen_load(rec_unseen *u, const float *const *picture, bool floats);
bool rec_unseen_present(const rec_unseen *u, size_t camera);
/* Of the set: b, weight (0 or 1) and lit (0 or 1) of a camera. */
const float *rec_unseen_b(const rec_unseen *u, size_t camera);
const float *rec_unseen_weight(const rec_unseen *u, size_t camera);
const uint8_t *rec_unseen_lit(const rec_unseen *u, size_t camera);
double rec_unseen_sigma(const rec_unseen *u);
/* Share of the noise of a camera's dark that is clipped at black; *pedestal: what it lacks (photo.h). */
double rec_unseen_cut(const rec_unseen *u, size_t camera, double *pedestal);

/* Camera c's pictures are multiplied by this gain, instead of the rig's, from the next load on. */
void rec_unseen_gain(rec_unseen *u, size_t camera, double gain);
/* The flame absorbs from the next load or solve on.  Then b is its emission (absorb.h), and so is the result of
 * rec_unseen_project, not what is seen. */
void rec_unseen_absorb(rec_unseen *u, double absorption);

/* The volume of the set's cameras with use[c], by (1).  n: its voxels; 0 = the silhouettes do not meet.
 * Errors: those of rec_frame_solve. */
PVX_MUST_CHECK pvx_err rec_unseen_solve(rec_unseen *u, const bool *use, int32_t *n);
/* With params.temporal: the next volume has no volume before it; without this call it has that of the last solve. */
void rec_unseen_forget(rec_unseen *u);
/* That volume as camera c should see it, and the metres of its hull that a bin looks through; either may be NULL.
 * Owner: u, until the next call. */
void rec_unseen_project(rec_unseen *u, size_t camera, const float **picture, const float **hull);
void rec_unseen_volume(const rec_unseen *u, struct rec_sparse *out);
/* That volume's columns and the rows of cameras use[c].  Owner: u, until the next project. */
const struct rec_subsys *rec_unseen_system(rec_unseen *u, const bool *use, struct rec_images **im);

#endif
