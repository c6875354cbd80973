/* wrong.h - the faults that a camera of a once correct rig can have: one list for the vote of every frame set, for
 * `calibrate check` and for the daemon's alarm.
 * Threads: pure. */
#ifndef REC_WRONG_H
#define REC_WRONG_H

#ifdef __cplusplus
extern "C" {
#endif

enum rec_wrong {
    REC_WRONG_NOTHING,
    REC_WRONG_DARK,      /* nothing lit where the others see flame */
    REC_WRONG_FLOODED,   /* lit or saturated where the others see none */
    REC_WRONG_MOVED,     /* its picture is displaced */
    REC_WRONG_MIRRORED,  /* or upside down */
    REC_WRONG_LATE,      /* taken at another instant, or frozen */
    REC_WRONG_BLURRED,   /* out of focus */
    REC_WRONG_GAIN,      /* brighter or darker than the others predict */
    REC_WRONG_DISAGREES, /* it contradicts the others for an unknown reason */
    REC_N_WRONG
};

/* "dark", "moved" ..., as reports and the wire write it; "" for NOTHING. */
const char *rec_wrong_name(enum rec_wrong w);
/* What to do about it, one clause: "take the cap off ..."; "" for NOTHING. */
const char *rec_wrong_remedy(enum rec_wrong w);

#ifdef __cplusplus
}
#endif
#endif
