/* verdict.h - which cameras of a frame set are believed: the result of vote.h, for its readers.
 * R and the limit (3) are those of vote.h.
 * Threads: pure. */
#ifndef REC_VERDICT_H
#define REC_VERDICT_H
#include <stdint.h>
#include "recon/geom/rig.h"
#include "recon/vote/wrong.h"

#ifdef __cplusplus
extern "C" {
#endif

enum rec_vote_state {
    REC_VOTE_NONE,  /* no vote was taken */
    REC_VOTE_FEW,   /* fewer than four cameras */
    REC_VOTE_DARK,  /* fewer than three cameras see a flame */
    REC_VOTE_AGREE, /* all cameras are believed */
    REC_VOTE_OUT,   /* some cameras are not, the others agree */
    REC_VOTE_TORN,  /* the cameras contradict each other, and the wrong ones cannot be told */
    REC_N_VOTE_STATES
};
/* "none", "few" ..., as reports write it. */
const char *rec_vote_state_name(enum rec_vote_state s);

struct rec_verdict {
    enum rec_vote_state state;
    uint64_t out;                 /* bit c: camera c is not believed */
    uint8_t why[REC_MAX_CAMERAS]; /* enum rec_wrong */
    /* The cost of believing each camera: (2) of vote.h among all cameras.  0 if R(all) was so small that the cameras
     * were not tested one by one. */
    float cost[REC_MAX_CAMERAS];
    float doubt;  /* the greatest ratio of a cost to its limit (3): over 1 is out */
    float misfit; /* R(believed cameras) / P, per camera */
};

#ifdef __cplusplus
}
#endif
#endif
