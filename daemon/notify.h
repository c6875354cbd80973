/* notify.h - word to the service manager (sd_notify): READY, STATUS, STOPPING, WATCHDOG.
 * Without a service manager all of it does nothing.  Threads: any. */
#ifndef DMN_NOTIFY_H
#define DMN_NOTIFY_H
#include <stdbool.h>
#include <stdint.h>
#include "base/err.h"

void dmn_notify_ready(const char *status);
void dmn_notify_status(const char *fmt, ...) PVX_PRINTF(1, 2);
void dmn_notify_stopping(void);
/* How often dmn_notify_alive must be called, ns: half of WatchdogSec; 0 = no watchdog. */
int64_t dmn_notify_watchdog(void);
void dmn_notify_alive(void);
#endif
