/* checks.h - what the daemon's own checks of the rig (recon/check/judge.h) say of each camera, from check to check:
 * its figures, the fault that it is named with, and a sentence when that changes.
 *
 * A check is of a few frame sets.  A camera is named when `patience` more checks found it wrong than right and the
 * last two agree.  It is cleared when as many found it right.
 * Threads: one caller per object. */
#ifndef DMN_CHECKS_H
#define DMN_CHECKS_H
#include "daemon/control/check_words.h"
#include "daemon/control/votes.h"

struct dmn_checks_camera {
    struct rec_check_camera figures; /* of the last check; wrong: the fault that is named */
    enum rec_wrong last;             /* what that check found */
    int lasting;                     /* checks that found something, less those that did not */
    bool said;
};

struct dmn_checks {
    uint64_t n;      /* checks that could be made */
    uint64_t failed; /* since the last of them: checks that had nothing to judge by */
    size_t n_wrong;  /* of the last check */
    enum rec_check_outcome outcome;
    int patience; /* 0 means 1 */
    int torn;     /* checks that could not tell which cameras are wrong, less those that could */
    bool said_torn;
    struct dmn_checks_camera camera[REC_MAX_CAMERAS];
};

/* One more check, which took cameras of `mask`.  known [rig's cameras]: the enum rec_wrong that is in the log for a
 * camera already; it is not logged again. */
struct dmn_checks_news {
    const struct rec_check_verdict *verdict;
    uint64_t mask;
    const uint8_t *known;
};
void dmn_checks_add(struct dmn_checks *k, const struct dmn_checks_news *news,
                    const struct rec_rig *rig, const struct dmn_votes_listener *to);

/* Camera c's object "check": {"wrong", "text", figures}. */
void dmn_checks_camera_json(struct dmn_json *j, const struct dmn_checks *k, size_t c);
/* Object "check": {"checks", "failed", "outcome", "text"}; outcome "" and text "": none yet. */
void dmn_checks_json(struct dmn_json *j, const struct dmn_checks *k, size_t n_cameras);

#endif
