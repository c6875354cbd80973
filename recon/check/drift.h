/* drift.h - has a camera been moved?  Asked while sets come in, of one camera at a time.
 *
 * A look at camera c takes one frame set: the volume of the others, its picture in c and the displacement d of c's
 * own picture against it (unseen.h, shift.h).  Over the last REC_DRIFT_LOOKS looks at a camera, with the information
 * matrices A of shift.h,
 *     m = (sum A)^-1 sum A d,   e^2 = sum |d - m|^2 / (n (n - 1))                                  (1)
 * and with m0, e0 those of the first looks at it in this session, a camera is suspected when
 *     |m - m0| > F + k sqrt(e^2 + e0^2)   or   |m| > G + k e                                       (2)
 * F, G raw pixels, F not less than a share of a bin.  A moved camera distorts the volumes of all others and shifts
 * their pictures against them.  So the camera furthest beyond (2) is left out of the volumes, and all cameras are
 * looked at anew.  If it is still beyond (2) it is named, otherwise acquitted.  A named camera stays out of the
 * volumes until |m - m0| and |m| are below half of (2).  m0 is forgotten when other cameras make the sets.  An
 * occasional set that lacks a camera is skipped.
 * Source of the displacement: B. Wieneke, Exp. Fluids 45:549, 2008; how reliable (2) is: NUMERICS.md.
 * Cost: a look is a solve of the small grid of unseen.h.  Memory: three pictures and 1 KiB a camera.
 * Threads: one call at a time, parallel inside.  Owner: caller.  The volumes are borrowed; between two sets other
 * code may use them too (check.h). */
#ifndef REC_DRIFT_H
#define REC_DRIFT_H
#include "recon/check/unseen.h"

#define REC_DRIFT_LOOKS 4
#define REC_DRIFT_LEAST 4 /* cameras */

struct rec_drift_params {
    double moved_px, off_px; /* F, G of (2) */
    double moved_bins;       /* F is at least this share of a bin, G four times that */
    double sigmas;           /* k */
};
#define REC_DRIFT_DEFAULTS                                           \
    {                                                                \
        .moved_px = 0.5, .off_px = 2, .moved_bins = 0.1, .sigmas = 3 \
    }

struct rec_drift_camera {
    bool moved;      /* named */
    uint64_t looks;  /* looks that gave a displacement, in all */
    double px[2];    /* m, raw pixels: to the right, down */
    double since[2]; /* m - m0; 0 before there is m0 */
};

typedef struct rec_drift rec_drift;

/* G of (2) in raw pixels: a smaller displacement may come from the calibration. */
double rec_drift_off(const struct rec_drift_params *p, int32_t binning);

/* Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_drift_new(rec_unseen *u, const struct rec_drift_params *p,
                                     rec_drift **out, struct pvx_diag *d);
void rec_drift_free(rec_drift **d);
/* A set's pictures as for rec_unseen_load, NULL = missing or not believed.  One camera of each eight is looked at, in
 * turn; none with fewer than four pictures.  changed: bits of cameras that were named or taken back.
 * Errors: those of rec_unseen_solve. */
PVX_MUST_CHECK pvx_err rec_drift_add(rec_drift *d, const float *const *picture, bool floats,
                                     uint64_t *changed);
const struct rec_drift_camera *rec_drift_of(const rec_drift *d, size_t camera);

#endif
