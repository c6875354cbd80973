/* trials.h - the single change of pictures or rig that explains the pictures better.
 *
 * Tried: the picture of a camera, or all pictures, mirrored, upside down or turned by 180 degrees; the pictures of two
 * cameras swapped; a camera up to REC_TRIALS_LATE sets late or early; R, t and K of all cameras, or of one, read in
 * another way (recon/geom/blind.h); a larger volume.
 * E is the mean of coarse.h (2) over cameras and sets, each camera against the volume of all others.  What concerns one
 * camera or two is first judged on the volume of the rest, which had no part in the mistake.  A change wins if it
 * lowers E and the misfit of its own cameras clearly, by the shares of trials.c, and if no other change comes near.
 * Flames that look alike from all sides hide such mistakes: then none wins.
 * Threads: pure. */
#ifndef REC_TRIALS_H
#define REC_TRIALS_H
#include "recon/check/coarse.h"
#include "recon/check/plausible.h"

#define REC_TRIALS_LATE 3
#define REC_TRIALS_SETS 3 /* looked at, of at most */
#define REC_TRIALS_MOST 8

/* A frame set in blocks. */
struct rec_trials_set {
    uint64_t number;
    const struct rec_blocks *picture; /* [cameras]; some false: missing or dark */
};

struct rec_trials {
    const struct rec_rig *rig;
    int32_t binning;
    size_t n;                         /* sets, numbers ascending */
    const struct rec_trials_set *set; /* [n] */
    bool beyond;                      /* light lies on rays that miss the volume */
    const atomic_bool *stop;          /* true: the trials end; or NULL */
};

/* The picture of camera c that is `lag` sets later than set i; NULL: not there, or dark. */
const struct rec_blocks *rec_trials_later(const struct rec_trials *t, size_t i, size_t c, int lag);

struct rec_trials_found {
    size_t sets;                  /* looked at */
    double explained;             /* share of the light that a volume can explain, as it is */
    double now, then;             /* E as it is, and with the change; then 0: found by lags.h */
    double miss[REC_MAX_CAMERAS]; /* (2) of each camera as it is; NAN: no picture */
    double in[REC_MAX_CAMERAS];   /* the same against the volume of all cameras */
    double gain[REC_MAX_CAMERAS]; /* how bright it is, over what the others say; NAN: no picture */
    enum rec_cause cause;         /* NONE: no change wins */
    uint64_t cameras;             /* which it is about; 0: all */
    double min[3], max[3];        /* BOX or beyond: the volume that it takes, with text and next */
    char text[REC_PLAUSIBLE_TEXT], next[REC_PLAUSIBLE_TEXT];
};
/* Errors: PVX_ENOMEM, PVX_ECANCELED (stop). */
PVX_MUST_CHECK pvx_err rec_trials_run(const struct rec_trials *t, struct rec_trials_found *out);

#endif
