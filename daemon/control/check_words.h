/* check_words.h - words for what a check of the rig (recon/check) found, for people and programs; `calibrate check`
 * and the daemon's own checks share them.
 * Threads: pure. */
#ifndef DMN_CHECK_WORDS_H
#define DMN_CHECK_WORDS_H
#include "daemon/control/json.h"
#include "recon/check/judge.h"

#define DMN_CHECK_WORDS 600

/* "gain: 0.85 times as bright as the others say; look at ..."; "" for nothing. */
void dmn_check_sentence(const struct rec_check_camera *o, char out[DMN_CHECK_WORDS]);
/* Of all n cameras: whether they agree, and if not, whether it is known which are wrong. */
void dmn_check_conclusion(enum rec_check_outcome outcome, size_t n_wrong, size_t n,
                          char out[DMN_CHECK_WORDS]);
/* "agrees", "named", "cannot be told" */
const char *dmn_check_outcome(enum rec_check_outcome outcome);
/* "3.0 right, 2.0 up" */
void dmn_check_direction(const double shift[2], char out[64]);
/* All figures of a camera into the object that is open: "sets", "right_px" ... */
void dmn_check_figures_json(struct dmn_json *j, const struct rec_check_camera *o);

#endif
