/* record_raw.h - `pyrovox record --raw`: a running daemon begins or ends a take of raw frames. */
#ifndef RECORD_RAW_H
#define RECORD_RAW_H
#include "cli/cli.h"

/* action "start" or "stop"; out: the take's file, NULL = as the daemon is configured.  Exit code. */
int record_raw(const char *control, const char *action, const char *out);
#endif
