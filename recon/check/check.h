/* check.h - does a flame agree with the rig?  Each camera against the volume of the others, set by set.
 *
 * For every set and camera c, p_c of unseen.h is compared with the camera's own picture b_c, both smoothed:
 *   displacement   shift.h, posefit.h; its standard error from the spread over sets
 *   rho            correlation (2) of shift.h unshifted and at the best displacement; also of p with the mirrored
 *                  b, and with the pictures of REC_CHECK_LATE sets before and after
 *   gain           sum b / sum p where p > 0: a volume of few views is too soft between them, but has all its light
 *   blur           effect of a Gaussian of that sigma on sum |grad b|^2 / sum b^2, compared with that of p:
 *                      sigma^2 = E_b/G_b - E_p/G_p,  E = sum b^2, G = sum |grad b|^2                    (1)
 *                  (exact where the structures are Gaussian, whatever their size)
 *   coverage       share of its own light that the hull of the others can explain; share of the light it should
 *                  see where it is lit
 *   residual       ||b - p|| / ||b|| with p from the others (gain fitted), and from all cameras
 * Only sums are kept, and the pictures of the last REC_CHECK_LATE sets: memory does not grow with the sets.
 * A faulty camera also spoils the volumes that it takes part in.  So cameras can be kept out of all volumes
 * (rec_check_begin), and judge.h finds out which are faulty.
 * Threads: one call at a time, parallel inside; same bits for any number of threads.  After new, only
 * rec_frame_solve allocates.  Owner: caller; pool is borrowed. */
#ifndef REC_CHECK_H
#define REC_CHECK_H
#include "recon/check/posefit.h"
#include "recon/check/unseen.h"
#include "recon/vote/wrong.h"

#define REC_CHECK_LATE 4
#define REC_CHECK_LAGS (2 * REC_CHECK_LATE + 1)

/* One camera, over all sets since rec_check_begin. */
struct rec_check_camera {
    uint32_t sets;   /* sets with its picture in which it should have seen flame */
    double shift[2]; /* raw pixels, right and down: its flame's place minus the expected place */
    double sigma[2]; /* standard errors of the mean; 0: fewer than 2 sets */
    double roll;     /* rad, clockwise */
    double size;     /* its flame's size / expected size - 1 */
    double rho, rho_moved, rho_mirrored; /* means; moved: at the best displacement */
    unsigned mirrored; /* direction of that mirroring: bit 0 left to right, bit 1 top to bottom */
    double rho_late
        [REC_CHECK_LAGS]; /* [REC_CHECK_LATE + k]: as if it were k sets late; NAN: not seen */
    double late_z
        [REC_CHECK_LAGS]; /* its mean gain in rho over lag 0, taken set by set, in standard errors */
    double still;         /* its change from set to set / the expected change; NAN: not known */
    double gain;
    double blur;      /* raw pixels; < 0: sharper than the volume shows */
    double explained; /* shares of light, see coverage; 1 is right */
    double lit;
    double area;              /* share of its bins that are lit */
    double saturated;         /* share of its bins that have no weight */
    double residual, with_it; /* with the others' volume; with that of all cameras */
    enum rec_wrong wrong;     /* judge.h */
};

struct rec_check_figures {
    uint32_t sets;
    bool use[REC_MAX_CAMERAS]; /* takes part in the volumes of the others */
    double moves;              /* change of the flame since the first set / noise, median camera */
    struct rec_check_camera camera[REC_MAX_CAMERAS];
};

typedef struct rec_check rec_check;

PVX_MUST_CHECK pvx_err rec_check_new(const struct rec_rig *rig, const struct rec_unseen_params *p,
                                     pvx_pool *pool, rec_check **out, struct pvx_diag *d);
void rec_check_free(rec_check **k);
/* The volumes of the others.  The caller may make its own with it between two sets. */
rec_unseen *rec_check_unseen(rec_check *k);
const rec_sysmat *rec_check_matrix(const rec_check *k);

/* Forgets all sets; use[c] false: camera c is judged, but takes part in no volume.  NULL: all do. */
void rec_check_begin(rec_check *k, const bool *use);

/* A set: its number (numbers ascend) and its pictures [bh][bw], linear, one channel; NULL = missing. */
struct rec_check_set {
    uint64_t number;
    const float *const *picture; /* [cameras] */
    bool floats;                 /* without a full scale (frame.h) */
};
PVX_MUST_CHECK pvx_err rec_check_add(rec_check *k, const struct rec_check_set *s);
void rec_check_get(const rec_check *k, struct rec_check_figures *out);
/* Displacements of camera c by windows, over all sets. */
const struct rec_lattice *rec_check_lattice(const rec_check *k, size_t c);
/* Of the set added last: the hull of the others seen by camera c, c's own picture, and the picture that it should
 * see; NULL where it is missing.  For pictures of the check; computed anew.  Errors: those of rec_check_add. */
struct rec_check_picture {
    int32_t bw, bh;
    const float *b, *p, *hull;
    const uint8_t *lit;
};
PVX_MUST_CHECK pvx_err rec_check_look(rec_check *k, size_t c, struct rec_check_picture *out);
/* Agreement, in the set added last, with the volume made without both cameras: correlation of camera c (rho[0])
 * and of camera `without` (rho[1]).  Errors: those of rec_check_add. */
PVX_MUST_CHECK pvx_err rec_check_pair(rec_check *k, size_t c, size_t without, double rho[2]);
/* Loads a set for rec_check_look and rec_check_pair without adding it. */
void rec_check_load(rec_check *k, const struct rec_check_set *s);

#endif
