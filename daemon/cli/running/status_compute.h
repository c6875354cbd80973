/* status_compute.h - where sets are solved, in words from a daemon's status. */
#ifndef STATUS_COMPUTE_H
#define STATUS_COMPUTE_H
#include <cjson/cJSON.h>
#include <stddef.h>

/* In one line.  0: on the processors alone, as usual. */
size_t compute_line(const cJSON *status, char *out, size_t size);
#endif
