/* status_cameras.h - print from a daemon's status how its cameras are and how well they work together. */
#ifndef STATUS_CAMERAS_H
#define STATUS_CAMERAS_H
#include <cjson/cJSON.h>
#include "daemon/cli/common/verdict.h"

/* Print table and histogram of each camera's exposures relative to their sets.  Nothing if there are none. */
void skew_print(const cJSON *status);
/* Print what is wrong with the cameras now, and the remedies.  Nothing if all is well. */
void troubles_print(const cJSON *status);
/* Print which cameras are left out of the sets because they contradict the others, and why.  Nothing if all agree. */
void votes_print(const cJSON *status);
/* How a camera's gain and aim are corrected; "": not at all. */
const char *selfcal_words(const cJSON *camera, char *out, size_t size);
void selfcal_print(const cJSON *status); /* of each camera that is corrected */
/* Print each camera's comparison with the others by the flame: agreement, displacement, gain.  Nothing before the
 * first check was done. */
void checks_print(const cJSON *status);
/* Print temperature, link and PTP of cameras, and action commands.  Nothing for cameras that do not report them. */
void health_print(const cJSON *status);

#endif
