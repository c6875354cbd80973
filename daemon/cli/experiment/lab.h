/* lab.h - one matrix of all cameras, and what a camera that had no part in a volume sees of that volume.
 *
 *     D_c = 255 mean over bins of | p_c - S_c x |                                                 (1)
 *
 * p: the picture, linear, 1 = full scale, without black level; x: the volume of the cameras used.  D_c is computed over
 * the bins of the model's silhouette (S_c x is at least 1/2 of 1/255), as in section 6.2 of the method's paper, and again
 * with the bins that only the picture's silhouette has.  Bins that are saturated or not finite are left out.
 * Threads: one call at a time, parallel inside.  Owner: caller. */
#ifndef EXPERIMENT_LAB_H
#define EXPERIMENT_LAB_H
#include "daemon/cli/common/frames_in.h"
#include "recon/frame/inside.h"

#define EXPERIMENT_SHOWS (0.5F / 255)

struct experiment_lab {
    struct rec_rig rig; /* with the lab's grid */
    rec_sysmat *S;
    rec_frame *frame;
    struct rec_kernels kernels;
    struct rec_subsys *view; /* the volume's columns, one camera's rows */
    struct rec_restrictor *restrictor;
    struct rec_images images;
    int nch, cs;
    float *raw, *b, *weight; /* [rows][cs], [rows][cs], [rows] of the set, of all cameras */
    uint8_t *lit;            /* [rows] */
    float *seen;             /* [room][cs] by the last comparison */
    bool said_lit;           /* that nearly all of a picture is */
};

/* How to make one. */
struct experiment_lab_params {
    const struct rec_rig *rig; /* its box; copied */
    int32_t voxels;            /* along the longest side */
    enum rec_basis basis;
    struct rec_sysmat_params matrix;
    struct rec_frame_params frame;
    pvx_pool *pool;
    struct rec_progress progress;
};
/* The bins of one camera. */
struct experiment_view {
    size_t rows;
    int nch, cs;
    const float *p, *q;  /* [rows][cs]: the picture, what the model shows */
    const float *weight; /* [rows]; 0: saturated, or no number */
    const uint8_t *lit;  /* [rows]: in the picture's silhouette */
};
struct experiment_error {
    double inside[3], all[3]; /* of each channel, 0..255 */
    double bins, bins_all;
};

/* Errors: those of rec_fit_grid, rec_sysmat_open and rec_frame_alone.  After an error too: close. */
PVX_MUST_CHECK pvx_err experiment_lab_open(struct experiment_lab *l,
                                           const struct experiment_lab_params *p,
                                           struct pvx_diag *d);
void experiment_lab_close(struct experiment_lab *l);
/* Use p->frame from now on, with the same matrix.  The set must be loaded again.  Errors: those of rec_frame_alone. */
PVX_MUST_CHECK pvx_err experiment_lab_frame(struct experiment_lab *l,
                                            const struct experiment_lab_params *p,
                                            struct pvx_diag *d);
/* Set i, which lacks no camera.  PVX_EIO: a file of it cannot be used. */
PVX_MUST_CHECK pvx_err experiment_lab_load(struct experiment_lab *l, struct frames_in *in, size_t i,
                                           struct pvx_diag *d);
/* The volume of the cameras in the mask; its voxels: rec_frame_volume.  Errors: those of rec_frame_solve. */
PVX_MUST_CHECK pvx_err experiment_lab_solve(struct experiment_lab *l, uint64_t used);
/* (1) in camera c. */
void experiment_lab_compare(struct experiment_lab *l, size_t c, struct experiment_error *out);
/* Camera c as it was compared last; borrowed. */
struct experiment_view experiment_lab_view(const struct experiment_lab *l, size_t c);

/* (1) */
void experiment_difference(const struct experiment_view *v, struct experiment_error *out);
/* What the model shows that is not there: share of its light on bins that are not lit, and the mean difference of all
 * bins and channels, 0..255. */
void experiment_ghosts(const struct experiment_view *v, double *share, double *difference);
/* Share of a volume's emission, [voxels][nch], in voxels where `inside` has none. */
double experiment_outside(const float *dense, const float *inside, size_t voxels, int nch);

#endif
