/* judge.h - what the figures of a check say of each camera, and which cameras of a rig lie.
 *
 * A camera is wrong by its figures alone, in this order (bounds and where they are from: NUMERICS.md):
 *   dark       it is lit where less than a tenth of its light is due, and shows less than a tenth of that
 *   flooded    most of it is lit or saturated, or most of its light nobody explains though the flame is in it
 *   mirrored   its mirror image agrees twice as well, counted by 1 - rho
 *   late       pictures of another set agree better, by 4 standard errors; or it hardly changes while the flame does
 *   moved      displaced, turned or resized by more than REC_CHECK_MOVED pixels at the flame's edge and more than 4
 *              standard errors; of a rig that says how far to trust it (rec_camera.uncertainty), by more than px_95
 *   blurred    wider than what is due, and than the others beside it by a Gaussian of 2 bins or more
 *   gain       off the median by a tenth
 *   disagrees  1 - rho above 0.1 and four times the median, or lit where the others have no volume at all
 *
 * A liar is in the volumes of all others, which then look wrong too.  So, as long as some of the cameras that are
 * believed are wrong: the one is left out without which the others agree best,
 *     L = argmax_L sum_c rho(c | all but c and L) - rho(c | all but c),    c and L believed, L wrong     (1)
 * over REC_CHECK_PAIRS sets, and all are judged again.  Where only one is wrong it is that one.  Four have to be
 * left that agree, and more than half; else it cannot be told.
 * Source: the removal of ghost cameras by consistency is our own; NUMERICS.md.
 * Threads: as rec_check. */
#ifndef REC_JUDGE_H
#define REC_JUDGE_H
#include "recon/check/check.h"

#define REC_CHECK_MOVED 0.75 /* raw pixels, at least 0.3 bins */
#define REC_CHECK_LEAST 4    /* cameras */
#define REC_CHECK_SETS  3
#define REC_CHECK_PAIRS 4

/* What each camera is called by its own figures, into f->camera[].wrong. */
void rec_check_name(const struct rec_rig *rig, int32_t binning, struct rec_check_figures *f);
/* More than so many raw pixels of displacement are none of the calibration's. */
double rec_check_floor(const struct rec_camera *c, int32_t binning);

/* Frame sets that can be had again and again, in order. */
struct rec_check_source {
    size_t n;
    /* Borrowed until the next call.  Errors end the check. */
    pvx_err (*get)(void *ctx, size_t i, struct rec_check_set *out);
    bool (*progress)(void *ctx, double done); /* before each get; or NULL; false: PVX_ECANCELED */
    void *ctx;
    const bool *doubted; /* [cameras] judged, but in nobody's volume from the start; or NULL */
};

enum rec_check_outcome { REC_CHECK_AGREES, REC_CHECK_NAMED, REC_CHECK_UNTOLD };
struct rec_check_verdict {
    enum rec_check_outcome outcome;
    size_t n_wrong;
    struct rec_check_figures
        figures; /* wrong: of NAMED, those that lie; of UNTOLD, all that look so */
};
/* Errors: PVX_EINVAL + diag where the flame or the rig tells nothing: fewer than REC_CHECK_LEAST cameras or
 * REC_CHECK_SETS sets, a flame that does not move, that fills no picture, that fewer than three cameras see;
 * PVX_ECANCELED; the source's. */
PVX_MUST_CHECK pvx_err rec_check_run(rec_check *k, const struct rec_rig *rig,
                                     const struct rec_check_source *s,
                                     struct rec_check_verdict *out, struct pvx_diag *d);

#endif
