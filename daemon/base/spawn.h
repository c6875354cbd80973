/* spawn.h - another program, started as if from a fresh shell. */
#ifndef PVX_SPAWN_H
#define PVX_SPAWN_H
#include <sys/types.h>

/* argv[0] is searched in PATH if it has no slash.  in: its standard input; out: its standard output and standard
 * error.  The program has no other open handle of ours, and no signal blocked or ignored.  It is a process group
 * of its own, so that a terminal's Ctrl-C does not reach it.  Returns 0 or errno; the caller waits for *pid. */
int pvx_spawn(const char *const argv[], int in, int out, pid_t *pid);
/* fork.  The child receives SIGTERM when this process ends; it ends with 125 if that has happened already. */
pid_t pvx_fork_bound(void);

#endif
