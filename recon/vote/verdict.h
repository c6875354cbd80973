/* verdict.h - which cameras of a frame set are believed: what vote.h finds, for who reads it.
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
    REC_VOTE_NONE,  /* nobody was asked */
    REC_VOTE_FEW,   /* fewer than four cameras */
    REC_VOTE_DARK,  /* no flame that three of them see */
    REC_VOTE_AGREE, /* all are believed */
    REC_VOTE_OUT,   /* some are not, the others agree */
    REC_VOTE_TORN,  /* they contradict each other, and who is wrong cannot be told */
    REC_N_VOTE_STATES
};
/* "none", "few" ..., as reports write it. */
const char *rec_vote_state_name(enum rec_vote_state s);

struct rec_verdict {
    enum rec_vote_state state;
    uint64_t out;                 /* bit c: camera c is not believed */
    uint8_t why[REC_MAX_CAMERAS]; /* enum rec_wrong */
    /* What believing it costs: (2) of vote.h among all cameras; 0 where R(all) is so small that nobody has to ask. */
    float cost[REC_MAX_CAMERAS];
    float doubt;  /* the greatest of them over what (3) lets it be: over 1 is out */
    float misfit; /* R(those believed) / P, a camera's share of it */
};

#ifdef __cplusplus
}
#endif
#endif
