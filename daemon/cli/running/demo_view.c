#include "daemon/cli/running/demo_view.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/spawn.h"

/* In the child, after fork. */
static void demo_view_become(const char *bin, const char *endpoint, const char *log, int out)
{
    char pyrovox[PATH_MAX + 16];
    snprintf(pyrovox, sizeof pyrovox, "%s/pyrovox", bin);
    setpgid(0, 0); /* only the demo receives a terminal's Ctrl-C */
    int err = open(log, O_WRONLY | O_CREAT | O_APPEND, 0600);
    if (err < 0 || dup2(out, 1) < 0 || dup2(err, 2) < 0)
        _exit(125);
    execl(pyrovox, pyrovox, "view", "--open", "--turn", "--listen", "127.0.0.1:0", "--endpoint",
          endpoint, (char *)NULL);
    _exit(127);
}

pvx_err demo_view_start(struct demo_view *v, const char *bin, const char *endpoint, const char *log,
                        struct pvx_diag *d)
{
    int fd[2];
    if (pipe2(fd, O_CLOEXEC) != 0)
        return pvx_fail(d, PVX_EIO, "no pipe to be had: %s", strerror(errno));
    v->pid = pvx_fork_bound();
    if (v->pid == 0)
        demo_view_become(bin, endpoint, log, fd[1]);
    close(fd[1]);
    if (v->pid < 0) {
        v->pid = 0;
        close(fd[0]);
        return pvx_fail(d, PVX_ENOMEM, "cannot start a process: %s", strerror(errno));
    }
    /* read one line, or until the program ends */
    size_t n = 0;
    while (n < sizeof v->url - 1 && read(fd[0], v->url + n, 1) == 1 && v->url[n] != '\n')
        n++;
    v->url[n] = '\0';
    close(fd[0]);
    if (strncmp(v->url, "http", 4) == 0)
        return PVX_OK;
    demo_view_stop(v);
    return pvx_fail(d, PVX_EIO, "pyrovox view did not start");
}

void demo_view_stop(struct demo_view *v)
{
    if (v->pid <= 0)
        return;
    kill(v->pid, SIGTERM);
    while (waitpid(v->pid, NULL, 0) < 0 && errno == EINTR)
        continue;
    v->pid = 0;
}
