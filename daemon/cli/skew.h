/* skew.h - how well the cameras work together, as text, from a daemon's status. */
#ifndef SKEW_H
#define SKEW_H
#include <cjson/cJSON.h>

/* Table and histogram of each camera's exposures against their sets; nothing when there are none. */
void skew_print(const cJSON *status);
/* What is wrong with the cameras now and what to do about it; nothing when all is well. */
void troubles_print(const cJSON *status);

#endif
