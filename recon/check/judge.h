/* judge.h - what the figures of a check say of each camera, and which cameras of a rig are faulty.
 *
 * A camera is judged by its own figures, in this order (bounds and their origin: NUMERICS.md):
 *   dark       lit where less than a tenth of its expected light is, and shows less than a tenth of that light
 *   flooded    most of it is lit or saturated, or the others explain little of its light though the flame is in it
 *   mirrored   its mirror image agrees twice as well, counted by 1 - rho
 *   late       pictures of another set agree better, by 4 standard errors; or it hardly changes while the flame does
 *   moved      displaced, turned or resized by more than REC_CHECK_MOVED pixels at the flame's edge and more than 4
 *              standard errors; if the rig states its uncertainty (rec_camera.uncertainty), by more than px_95
 *   blurred    wider than expected, and wider than the other cameras by a Gaussian of 2 bins or more
 *   gain       off the median by a tenth
 *   disagrees  1 - rho above 0.1 and four times the median, or lit where the others have no volume at all
 *
 * A faulty camera takes part in the volumes of all others, which then look wrong too.  So, as long as some of the
 * believed cameras are wrong, it leaves out the camera without which the others agree best,
 *     L = argmax_L sum_c rho(c | all but c and L) - rho(c | all but c),    c and L believed, L wrong     (1)
 * over REC_CHECK_PAIRS sets, and judges all again.  If only one is wrong, it is that one.  At least four cameras that
 * agree must be left, and more than half; otherwise it cannot be told.
 * Source: the removal of ghost cameras by consistency is our own; NUMERICS.md.
 * Threads: as rec_check. */
#ifndef REC_JUDGE_H
#define REC_JUDGE_H
#include "recon/check/check.h"

#define REC_CHECK_MOVED 0.75 /* raw pixels, at least 0.3 bins */
#define REC_CHECK_LEAST 4    /* cameras */
#define REC_CHECK_SETS  3
#define REC_CHECK_PAIRS 4

/* Judges each camera by its own figures, into f->camera[].wrong. */
void rec_check_name(const struct rec_rig *rig, int32_t binning, struct rec_check_figures *f);
/* Displacement in raw pixels beyond which the calibration cannot be the cause. */
double rec_check_floor(const struct rec_camera *c, int32_t binning);

/* Frame sets that can be read repeatedly, in order. */
struct rec_check_source {
    size_t n;
    /* Borrowed until the next call.  Errors end the check. */
    pvx_err (*get)(void *ctx, size_t i, struct rec_check_set *out);
    bool (*progress)(void *ctx, double done); /* before each get; or NULL; false: PVX_ECANCELED */
    void *ctx;
    const bool *doubted; /* [cameras] judged, but in no volume from the start; or NULL */
};

enum rec_check_outcome { REC_CHECK_AGREES, REC_CHECK_NAMED, REC_CHECK_UNTOLD };
struct rec_check_verdict {
    enum rec_check_outcome outcome;
    size_t n_wrong;
    struct rec_check_figures
        figures; /* wrong: NAMED: the faulty ones; UNTOLD: all that look faulty */
};
/* Errors: PVX_EINVAL + diag where flame or rig give no information: fewer than REC_CHECK_LEAST cameras or
 * REC_CHECK_SETS sets, or a flame that does not move, is too small in the pictures, or is seen by fewer than three
 * cameras; PVX_ECANCELED; the source's. */
PVX_MUST_CHECK pvx_err rec_check_run(rec_check *k, const struct rec_rig *rig,
                                     const struct rec_check_source *s,
                                     struct rec_check_verdict *out, struct pvx_diag *d);

#endif
