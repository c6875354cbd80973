/* survive.h - what could end the daemon without its doing, and what it knows again when it has been ended
 * (the table in capture/README.md).
 * Threads: the main thread. */
#ifndef DMN_SURVIVE_H
#define DMN_SURVIVE_H
#include <stdbool.h>

/* Before any thread is started: writing to a peer that is gone and past a limit of size are errors, not
 * signals; as many handles as the host allows, for libzmq aborts when there are none for one more client; and
 * when a mapped file is cut or its disk fails (SIGBUS) the file is named on the standard error
 * before the end, exit code 1. */
void dmn_survive(void);

/* A recording that was begun by command goes on, in a new take, when the daemon is started again after an
 * end that was not in order: remembered in the folder $STATE_DIRECTORY (systemd's StateDirectory=; without
 * one nothing is remembered). */
void dmn_remember_recording(bool on);
bool dmn_was_recording(void);
#endif
