/* information.h - what frames tell about cameras, and what one more frame would add: (1) and (2) of next.h.
 *
 * Every camera has 15 numbers: lens, then pose (world -> camera).  The pose of one camera defines the world, so
 * its variance is 0.  tr(L^-1 H) does not depend on which camera that is. */
#ifndef REC_CALIB_INFORMATION_H
#define REC_CALIB_INFORMATION_H
#include "recon/calib/calib.h"

#define REC_OF_CAMERA (REC_LENS + 6)

struct rec_information {
    const struct rec_calib_input *in;
    const struct rec_rig *rig;
    uint32_t nc;
    size_t N;                             /* REC_OF_CAMERA * nc */
    double error;                         /* tr(L^-1 H) */
    double (*lens)[REC_LENS], (*pose)[6]; /* [nc] */
    double least_square;                  /* px: smallest visible square; the caller's */
    double *weight;                       /* [nc] 1/px^2, of a coordinate of a corner */
    double *C, *T;                        /* [N][N]: L^-1; C H C */
    /* the frame under construction */
    double board[12]; /* R, t: board -> world */
    uint32_t n_seen, seen[REC_MAX_CAMERAS];
    double (*U)[REC_OF_CAMERA * REC_OF_CAMERA], (*W)[REC_OF_CAMERA * 6]; /* [n_seen] */
    double V[36];
    double *D, *M; /* work */
};

/* Owner: caller, fini, also after an error.  PVX_ENOENT: L has no inverse; PVX_EINVAL: rig or
 * report of other cameras; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_information_init(struct rec_information *w,
                                            const struct rec_calib_input *in,
                                            const struct rec_rig *rig,
                                            const struct rec_calib_report *r);
void rec_information_fini(struct rec_information *w);

/* Begin a frame with the board at `board`, then add each camera that sees it.  Only the ids of the corners are
 * used. */
void rec_information_begin(struct rec_information *w, const double board[12]);
void rec_information_view(struct rec_information *w, const struct rec_board_view *v);
/* By how much that frame would lower `error`; 0 if unknown. */
double rec_information_gain(struct rec_information *w);

#endif
