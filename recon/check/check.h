/* check.h - does a flame agree with the rig?  Each camera against the volume of the others, set by set.
 *
 * Of every set and camera c: p_c of unseen.h beside its own picture b_c, both smoothed:
 *   displacement   shift.h, posefit.h; its standard error from the spread over sets
 *   rho            correlation (2) of shift.h as they are and at the best displacement; the same of p with b
 *                  mirrored, and with the pictures of REC_CHECK_LATE sets before and after
 *   gain           sum b / sum p where p > 0: a volume of few views, too soft between them, has its light all the same
 *   blur           what a Gaussian of that sigma does to sum |grad b|^2 / sum b^2 beside p's:
 *                      sigma^2 = E_b/G_b - E_p/G_p,  E = sum b^2, G = sum |grad b|^2                    (1)
 *                  (exact where the structures are Gaussian, whatever their size)
 *   coverage       share of its own light that the hull of the others can explain; share of the light it should
 *                  see where it is lit
 *   residual       ||b - p|| / ||b|| with p from the others (gain fitted), and from all cameras
 * Sums only are kept, and the last REC_CHECK_LATE sets' pictures: memory does not grow with the sets.
 * A volume made with a camera that lies is wrong too.  So cameras can be kept out of all volumes
 * (rec_check_begin), and suspects.h finds out which.
 * Threads: one call at a time, parallel inside; same bits for any number of threads.  After new nothing allocates
 * but what rec_frame_solve takes.  Owner: caller; pool is borrowed. */
#ifndef REC_CHECK_H
#define REC_CHECK_H
#include "recon/check/posefit.h"
#include "recon/check/unseen.h"
#include "recon/vote/wrong.h"

#define REC_CHECK_LATE 4
#define REC_CHECK_LAGS (2 * REC_CHECK_LATE + 1)

/* One camera, over all sets since rec_check_begin. */
struct rec_check_camera {
    uint32_t sets;   /* that it was in, and should have seen flame in */
    double shift[2]; /* raw pixels, right and down: where its flame is, from where it should be */
    double sigma[2]; /* standard errors of the mean; 0: fewer than 2 sets */
    double roll;     /* rad, clockwise */
    double size;     /* its flame's size over what it should be, - 1 */
    double rho, rho_moved, rho_mirrored; /* means; moved: at the best displacement */
    unsigned mirrored; /* which way that is: bit 0 left to right, bit 1 top to bottom */
    double rho_late
        [REC_CHECK_LAGS]; /* [REC_CHECK_LATE + k]: as if it were k sets late; NAN: not seen */
    double late_z
        [REC_CHECK_LAGS]; /* its mean gain in rho over no lag, set by set, in standard errors */
    double still;         /* its own change from set to set over what it should be; NAN */
    double gain;
    double blur;      /* raw pixels; < 0: sharper than the volume shows */
    double explained; /* shares of light; 1 is right */
    double lit;
    double area;              /* share of its bins that are lit */
    double saturated;         /* share of its bins that have no weight */
    double residual, with_it; /* of the others' volume; of all cameras' */
    enum rec_wrong wrong;     /* judge.h */
};

struct rec_check_figures {
    uint32_t sets;
    bool use[REC_MAX_CAMERAS]; /* in the volumes of the others */
    double moves; /* change of the flame since the first set over its noise, median camera */
    struct rec_check_camera camera[REC_MAX_CAMERAS];
};

typedef struct rec_check rec_check;

PVX_MUST_CHECK pvx_err rec_check_new(const struct rec_rig *rig, const struct rec_unseen_params *p,
                                     pvx_pool *pool, rec_check **out, struct pvx_diag *d);
void rec_check_free(rec_check **k);
/* The volumes of the others, for whoever else makes some between two sets. */
rec_unseen *rec_check_unseen(rec_check *k);
const rec_sysmat *rec_check_matrix(const rec_check *k);

/* Forgets all sets; use[c] false: camera c is judged, but in nobody's volume.  NULL: all. */
void rec_check_begin(rec_check *k, const bool *use);

/* A set: its number, which ascend, and its pictures [bh][bw], linear, one channel; NULL = missing. */
struct rec_check_set {
    uint64_t number;
    const float *const *picture; /* [cameras] */
    bool floats;                 /* without a full scale (frame.h) */
};
PVX_MUST_CHECK pvx_err rec_check_add(rec_check *k, const struct rec_check_set *s);
void rec_check_get(const rec_check *k, struct rec_check_figures *out);
/* Displacements of camera c by windows, of all sets. */
const struct rec_lattice *rec_check_lattice(const rec_check *k, size_t c);
/* Of the set added last: the hull of the others through camera c, its own picture, what it should be; NULL where it
 * is missing.  For pictures of the check; made anew.  Errors: those of rec_check_add. */
struct rec_check_picture {
    int32_t bw, bh;
    const float *b, *p, *hull;
    const uint8_t *lit;
};
PVX_MUST_CHECK pvx_err rec_check_look(rec_check *k, size_t c, struct rec_check_picture *out);
/* How well camera c of the set added last agrees with the volume without c and `without`, and the other way round:
 * correlations, rho[0] and rho[1].  Errors: those of rec_check_add. */
PVX_MUST_CHECK pvx_err rec_check_pair(rec_check *k, size_t c, size_t without, double rho[2]);
/* Loads a set for rec_check_look and rec_check_pair without adding it. */
void rec_check_load(rec_check *k, const struct rec_check_set *s);

#endif
