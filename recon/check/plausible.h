/* plausible.h - do pictures and rig belong together, and if not, which single change would make them?
 *
 * Facts first, from what a frame set has anyway: light on rays that miss the volume, lit and saturated shares,
 * pictures that repeat.  Then hypotheses, each judged on pictures that had no part in the volume (trials.h).
 * A cause is named only where it wins clearly.  Every cause has one sentence and one remedy, the same in all programs:
 *     good: residual 2.4 % (noise allows 2.1 %), 8 cameras agree, 0.0 % of the light outside the volume
 *     fair: residual 18.7 % (noise allows 0.1 %): calibration or model; 5 cameras agree, ...; next: ...
 *     bad: 23 % of the flame's light lies on rays that miss the volume; next: in rig.yaml make max z at least 1.2
 * How often it is right: NUMERICS.md, 18; tests/bench/bench_plausible.c.
 * Threads: one call at a time.  After new, only rec_plausible_judge allocates.  Owner: caller. */
#ifndef REC_PLAUSIBLE_H
#define REC_PLAUSIBLE_H
#include <stdatomic.h>

#include "recon/check/unseen.h"

#define REC_PLAUSIBLE_TEXT 512

enum rec_cause {
    REC_CAUSE_NONE,      /* they belong together */
    REC_CAUSE_DARK,      /* no flame in two cameras: nothing can be said */
    REC_CAUSE_BLACK,     /* most of the picture is lit: a black level or a background is missing */
    REC_CAUSE_SATURATED, /* much of the flame is at full scale */
    REC_CAUSE_BOX,       /* the flame is larger than the volume */
    REC_CAUSE_REPEATS,   /* a camera sends one picture again and again */
    REC_CAUSE_RIG,       /* R, t or K of rig.yaml mean something else */
    REC_CAUSE_TURNED,    /* pictures are mirrored or turned */
    REC_CAUSE_SWAPPED,   /* the pictures of two cameras are swapped */
    REC_CAUSE_LATE,      /* a camera is some frames late or early */
    REC_CAUSE_GAIN,      /* a camera is much brighter or darker than the others */
    REC_CAUSE_CAMERA,    /* a camera contradicts the others, and no single change explains it */
    REC_CAUSE_UNTOLD,    /* they do not belong together, and the cause cannot be told */
    REC_N_CAUSES
};
/* "black", "box" ..., for status and reports; "" for NONE. */
const char *rec_cause_name(enum rec_cause c);

struct rec_plausible_verdict {
    enum rec_cause cause;
    bool meaningless; /* volumes of such pictures show nothing */
    uint64_t cameras; /* those that the cause is about; 0: the whole rig */
    double residual,
        noise; /* shares, means of the sets; noise: what noise alone would leave; 0: not known */
    double outside;   /* share of the flame's light on rays that miss the volume */
    double saturated; /* share of the flame's bins at full scale */
    double before,
        after; /* misfit of left-out pictures as it is, and with the change; 0: not tried */
    char text[REC_PLAUSIBLE_TEXT]; /* what is wrong, a clause */
    char next[REC_PLAUSIBLE_TEXT]; /* what to do unless it is good, to be pasted */
};

/* "good", "bad"; "fair": they belong together, but the residual is far above the noise. */
const char *rec_plausible_word(const struct rec_plausible_verdict *v);
/* "good: TEXT", "fair: TEXT; next: NEXT" or "bad: TEXT; next: NEXT", with the residual unless it is bad. */
#define REC_PLAUSIBLE_LINE (2 * REC_PLAUSIBLE_TEXT + 200)
void rec_plausible_line(const struct rec_plausible_verdict *v, char line[REC_PLAUSIBLE_LINE]);

typedef struct rec_plausible rec_plausible;

/* A frame set after photometry: pictures [height / binning][width / binning][cs], their first nch values count. */
struct rec_plausible_set {
    uint64_t number; /* sets that follow each other have consecutive numbers */
    int nch, cs;
    const float *b[REC_MAX_CAMERAS];      /* NULL: missing */
    const float *weight[REC_MAX_CAMERAS]; /* 0: no value; NULL: all have one */
    const uint8_t *lit[REC_MAX_CAMERAS];  /* silhouettes */
    double residual, noise;               /* as in the verdict, 0: not known */
};

/* Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_plausible_new(const struct rec_rig *rig, int32_t binning,
                                         rec_plausible **out);
void rec_plausible_free(rec_plausible **p);
/* Saturated pixels are lower bounds already: the remedy does not say so again. */
void rec_plausible_at_least(rec_plausible *p);
/* While *stop is true, which another thread may set, hypotheses end.  NULL: never. */
void rec_plausible_stop(rec_plausible *p, const atomic_bool *stop);
/* Adds a set.  Some are kept for hypotheses: the first ones, until `judge` was called. */
void rec_plausible_add(rec_plausible *p, const struct rec_plausible_set *s);
/* The same of the set that was loaded last. */
void rec_plausible_add_unseen(rec_plausible *p, const rec_unseen *u, uint64_t number);
/* Forgets all sets. */
void rec_plausible_begin(rec_plausible *p);

enum rec_plausible_depth {
    REC_PLAUSIBLE_FACTS,     /* microseconds */
    REC_PLAUSIBLE_HYPOTHESES /* a second or so */
};
/* rig_path, frames: for the commands in `next`; NULL: rig.yaml, DIR.  Errors: PVX_ENOMEM, PVX_ECANCELED (stop). */
PVX_MUST_CHECK pvx_err rec_plausible_judge(rec_plausible *p, enum rec_plausible_depth depth,
                                           const char *rig_path, const char *frames,
                                           struct rec_plausible_verdict *out);

#endif
