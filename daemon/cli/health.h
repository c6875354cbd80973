/* health.h - temperature, link and PTP of cameras, and action commands, in `pyrovox status`. */
#ifndef CLI_HEALTH_H
#define CLI_HEALTH_H
#include <cjson/cJSON.h>

/* Tables on stdout, of what is known: nothing at all for cameras that say nothing. */
void health_print(const cJSON *status);
#endif
