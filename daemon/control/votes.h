/* votes.h - which cameras are left out of the frame sets because they contradict the others (recon/vote/vote.h),
 * from set to set: counts, and a sentence when that changes.
 * Threads: one caller per object. */
#ifndef DMN_VOTES_H
#define DMN_VOTES_H
#include <cjson/cJSON.h>
#include "base/log.h"
#include "daemon/control/json.h"
#include "recon/geom/rig.h"
#include "recon/vote/vote.h"

struct dmn_votes {
    uint64_t out; /* bit c: camera c, in the last set that was judged */
    enum rec_vote_state state;
    uint8_t why[REC_MAX_CAMERAS];                    /* enum rec_wrong */
    uint64_t left_out[REC_MAX_CAMERAS][REC_N_WRONG]; /* sets, by cause */
    uint64_t torn; /* sets in which cameras are wrong, but it is not known which */
    int lasting;   /* torn sets less later sets that were not torn, 0 to patience */
    int patience;  /* so many lasting ones are said; 0: the first.  Live they come and go */
    bool said_few, said_torn;
};

/* bad: something is wrong from now on; false: no more. */
struct dmn_votes_listener {
    void (*say)(void *ctx, bool bad, const struct pvx_about *about, const char *sentence);
    void *ctx;
};
extern const struct dmn_votes_listener dmn_votes_log; /* into the log: warnings, and news */

/* Adds one more set.  Says what has changed, with the remedy, and once that there are too few cameras to judge by. */
void dmn_votes_add(struct dmn_votes *v, const struct rec_verdict *set, const struct rec_rig *rig,
                   const struct dmn_votes_listener *to);

/* Camera c's object "vote": {"out", "why", "remedy", "sets", "causes": {}}. */
void dmn_votes_camera_json(struct dmn_json *j, const struct dmn_votes *v, size_t c);
/* A verdict's keys in a report: "vote": {"state", "misfit", "doubt"}, "out": [{"camera", "why", "cost"}]. */
void dmn_verdict_json(cJSON *o, const struct rec_verdict *set, const struct rec_rig *rig);

#endif
