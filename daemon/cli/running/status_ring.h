/* status_ring.h - raw frames in memory and their triggers, in words from a daemon's status. */
#ifndef STATUS_RING_H
#define STATUS_RING_H
#include <cjson/cJSON.h>
#include <stddef.h>

/* The ring in one line.  0: the daemon has none. */
size_t ring_line(const cJSON *status, char *out, size_t size);
/* One of `triggers` of the status in one line. */
void trigger_line(const cJSON *trigger, char *out, size_t size);
#endif
