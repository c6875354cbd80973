/* survive.h - events outside that would end the daemon, and its memory across such an end (table in
 * capture/README.md).
 * Threads: the main thread. */
#ifndef DMN_SURVIVE_H
#define DMN_SURVIVE_H
#include <stdbool.h>

/* Call it before any thread starts.  Writing to a closed peer or past a size limit becomes an error, not a signal.  The
 * process gets as many handles as the host allows, because libzmq aborts without one for a new client.  When a mapped file
 * is cut or its disk fails (SIGBUS), the file is named on standard error before the end, exit code 1. */
void dmn_survive(void);

/* A recording that was begun by command goes on in a new take when the daemon starts after a crash.  This is stored in
 * the folder $STATE_DIRECTORY (systemd's StateDirectory=), and without one not at all. */
void dmn_remember_recording(bool on);
bool dmn_was_recording(void);
#endif
