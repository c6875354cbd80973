/* lags.h - cameras that are some frame sets late or early of a flame that changes little from set to set.
 *
 * b is a camera's picture in blocks, p what the volume of the other cameras shows it, g the gain between them, and v half
 * of what changes from the set before to the set after:
 *     r = b - g p,    a = -<r, v> / <v, v>   over all sets                                        (1)
 * A picture that is late by one set is b - v, so a = 1.  What coarse volumes miss is in r too, and gives all cameras some
 * a.  A camera is late if its a differs from the median by LATE, and CLEAR times as much as that of any other
 * camera, when all others are measured without it.  Its displacement has to be more than a pose that is off gives, and
 * a shift of its picture must not explain r much better than v does.
 * Threads: pure but for the work area. */
#ifndef REC_LAGS_H
#define REC_LAGS_H
#include "recon/check/trials.h"

struct rec_lags {
    const struct rec_trials *t;
    rec_coarse *coarse;
    struct rec_places *const *at; /* [cameras] */
};
/* Sets cause LATE, cameras, text and next, or nothing. */
void rec_lags_find(const struct rec_lags *k, struct rec_trials_found *out);

#endif
