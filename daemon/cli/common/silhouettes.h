/* silhouettes.h - silhouettes of recorded frame sets, without their system matrix.  The stages of a frame set run up
 * to the vote of the cameras, on the coarse grid of the vote.  Threads: one. */
#ifndef SILHOUETTES_H
#define SILHOUETTES_H
#include "daemon/cli/common/frames_in.h"
#include "recon/frame/frame.h"

struct silhouettes {
    struct frames_in *in;
    rec_sysmat *S;
    rec_carver *carver;
    rec_solver *solver; /* a frame needs one */
    rec_frame *frame;

    /* of the set that was loaded last: */
    const uint8_t *lit[REC_MAX_CAMERAS];  /* [bins] 0/1, the slot's */
    const float *weight[REC_MAX_CAMERAS]; /* [bins] the slot's */
    bool there[REC_MAX_CAMERAS];          /* cameras that are in the set */
    bool believed[REC_MAX_CAMERAS];       /* of those the cameras that the vote trusts */
    const struct rec_verdict *verdict;    /* the slot's */
};

/* `in` has begun; background: a folder as for frames_in_background, or NULL.  Errors: what it reads; PVX_ENOMEM.
 * silhouettes_free after an error too. */
PVX_MUST_CHECK pvx_err silhouettes_new(struct silhouettes *s, struct frames_in *in,
                                       const struct rec_frame_params *p, const char *background,
                                       pvx_pool *pool, struct pvx_diag *d);
void silhouettes_free(struct silhouettes *s);
void silhouettes_load(struct silhouettes *s, size_t set);

/* Count everything as flame.  The hull then drops only voxels that no camera sees. */
void silhouettes_without_hull(struct rec_frame_params *p);

/* Number of lit bins of an image.  Warns once when nearly all are lit: most often the black level is missing.
 * weight: of the bins; those without measure nothing, and count as lit. */
size_t silhouettes_check_lit(const char *camera, const uint8_t *lit, const float *weight,
                             size_t bins, bool *said);

#endif
