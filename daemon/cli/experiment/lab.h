/* lab.h - a matrix of all cameras, to compare a volume with the picture of a camera that was not used for it.
 *
 *     D_c = 255 mean over bins of | p_c - S_c x |                                                 (1)
 *
 * p: the picture, linear, 1 = full scale, without black level; x: the volume of the cameras used.  D_c is computed
 * over the bins of the model's silhouette (S_c x is at least 1/2 of 1/255), as in section 6.2 of the method's paper,
 * and again with the bins that only the picture's silhouette has.  Bins that are saturated or not finite are left
 * out.  Threads: one call at a time, parallel inside.  Owner: caller. */
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
    float *seen;             /* [room][cs] of the last comparison */
    bool said_lit;           /* the warning that nearly all is lit was printed */
};

/* Parameters of a lab. */
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
    const float *p, *q;  /* [rows][cs]: the picture, the model's picture */
    const float *weight; /* [rows]; 0: saturated or NaN */
    const uint8_t *lit;  /* [rows]: in the picture's silhouette */
};
struct experiment_error {
    double inside[3], all[3]; /* of each channel, 0..255 */
    double bins, bins_all;
};

/* Close it after an error, too.  Errors: those of rec_fit_grid, rec_sysmat_open and rec_frame_alone. */
PVX_MUST_CHECK pvx_err experiment_lab_open(struct experiment_lab *l,
                                           const struct experiment_lab_params *p,
                                           struct pvx_diag *d);
void experiment_lab_close(struct experiment_lab *l);
/* Use p->frame from now on, with the same matrix.  The set must be loaded again.  Errors: rec_frame_alone's. */
PVX_MUST_CHECK pvx_err experiment_lab_frame(struct experiment_lab *l,
                                            const struct experiment_lab_params *p,
                                            struct pvx_diag *d);
/* Load set i, which must be complete.  PVX_EIO: a file of it cannot be used. */
PVX_MUST_CHECK pvx_err experiment_lab_load(struct experiment_lab *l, struct frames_in *in, size_t i,
                                           struct pvx_diag *d);
/* Solve the volume from the cameras in the mask.  rec_frame_volume gives its voxels.  Errors: rec_frame_solve's. */
PVX_MUST_CHECK pvx_err experiment_lab_solve(struct experiment_lab *l, uint64_t used);
/* Compute (1) in camera c. */
void experiment_lab_compare(struct experiment_lab *l, size_t c, struct experiment_error *out);
/* The bins of camera c from its last comparison.  Borrowed. */
struct experiment_view experiment_lab_view(const struct experiment_lab *l, size_t c);

/* (1) */
void experiment_difference(const struct experiment_view *v, struct experiment_error *out);
/* Ghosts: the share of the model's light on bins that are not lit, and the mean difference of all bins and channels,
 * 0..255. */
void experiment_ghosts(const struct experiment_view *v, double *share, double *difference);
/* Share of the emission of volume `dense` [voxels][nch] that lies in voxels where `inside` has none. */
double experiment_outside(const float *dense, const float *inside, size_t voxels, int nch);

#endif
