/* verdict.h - what a daemon's status says of the whole, in one line, and of each camera. */
#ifndef VERDICT_H
#define VERDICT_H
#include <cjson/cJSON.h>
#include <stdbool.h>
#include "recon/check/plausible.h"

/* Whether a camera (of "cameras") is in another place than in the rig. */
bool camera_moved(const cJSON *camera);
/* Why the checks call a camera (of "cameras") wrong, as one clause.  "": it is right, or vote or drift report it. */
const char *camera_check(const cJSON *camera);
#define STATUS_LINE REC_PLAUSIBLE_LINE
/* Trouble of a camera: why it does not run, else why it is left out, else the first thing wrong and its remedy. */
void camera_trouble(const cJSON *camera, char out[STATUS_LINE]);
/* The verdict of "belong", or of an answer to check, without cause and cameras. */
void belong_verdict(const cJSON *belong, struct rec_plausible_verdict *out);
/* "good: ...", "fair: ...; next: ..." or "bad: ...; next: ...": what the daemon knows, in one line.  Returns whether it
 * is not bad. */
bool verdict_line(const cJSON *status, char out[STATUS_LINE]);

#endif
