/* status_cameras.h - how the cameras are and how well they work together, as text, from a daemon's status. */
#ifndef STATUS_CAMERAS_H
#define STATUS_CAMERAS_H
#include <cjson/cJSON.h>
#include <stdbool.h>

/* Table and histogram of each camera's exposures against their sets; nothing when there are none. */
void skew_print(const cJSON *status);
/* Whether a camera (of "cameras") is not where the rig says. */
bool camera_moved(const cJSON *camera);
/* What is wrong with the cameras now and what to do about it; nothing when all is well. */
void troubles_print(const cJSON *status);
/* Which cameras are left out of the sets because they contradict the others, and why; nothing when they agree. */
void votes_print(const cJSON *status);
/* What the flame says of each camera against the others: agreement, displacement, gain; nothing before the first check. */
void checks_print(const cJSON *status);
/* Why the checks call a camera (of "cameras") wrong, one clause; "" for nothing, and for what the vote or the drift say. */
const char *camera_check(const cJSON *camera);
/* Temperature, link and PTP of cameras, and action commands: nothing for cameras that say nothing. */
void health_print(const cJSON *status);

#endif
