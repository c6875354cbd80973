/* spawn.h - another program, started as if from a fresh shell. */
#ifndef PVX_SPAWN_H
#define PVX_SPAWN_H
#include <sys/types.h>

/* argv[0] is found by PATH where it has no slash.  in is its standard input, out what it writes and complains
 * to; no other handle of ours is open there, no signal blocked or ignored, and it is a process group of its own,
 * so that a terminal's Ctrl-C does not reach it.  0 or errno; the caller waits for *pid. */
int pvx_spawn(const char *const argv[], int in, int out, pid_t *pid);

#endif
