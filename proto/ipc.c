#include "proto/ipc.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

struct pvp_ipc_claim {
    int fd;
    char path[sizeof((struct sockaddr_un *)0)->sun_path];
    char lock[sizeof((struct sockaddr_un *)0)->sun_path + sizeof ".lock"];
};

static pvx_err busy(const char *endpoint, long pid, struct pvx_diag *d)
{
    char who[48] = "another program";
    if (pid > 0)
        snprintf(who, sizeof who, "process %ld", pid);
    return pvx_fail(d, PVX_EBUSY, "%s: in use by %s; stop it or configure another endpoint",
                    endpoint, who);
}

/* Opens and locks c->lock.  The former owner removes the file while it holds the lock, so the
 * locked file may no longer be the one with that name.  Then this is repeated. */
static pvx_err get_lock(struct pvp_ipc_claim *c, const char *endpoint, struct pvx_diag *d)
{
    for (;;) {
        c->fd = open(c->lock, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
        if (c->fd < 0) {
            int en = errno;
            return pvx_fail(d, pvx_err_from_errno(en), "%s: cannot create %s: %s", endpoint,
                            c->lock, strerror(en));
        }
        if (flock(c->fd, LOCK_EX | LOCK_NB) != 0) {
            char pid[24] = "";
            ssize_t n = pread(c->fd, pid, sizeof pid - 1, 0);
            pid[n > 0 ? n : 0] = '\0';
            close(c->fd);
            c->fd = -1;
            return busy(endpoint, strtol(pid, NULL, 10), d);
        }
        struct stat mine, named;
        if (fstat(c->fd, &mine) == 0 && stat(c->lock, &named) == 0 && mine.st_ino == named.st_ino &&
            mine.st_dev == named.st_dev)
            return PVX_OK;
        close(c->fd);
    }
}

/* Whether some program listens there; it need not know of the lock. */
static int somebody_listens(const char *path)
{
    int s = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (s < 0)
        return 0;
    struct sockaddr_un a = {.sun_family = AF_UNIX};
    memcpy(a.sun_path, path, strlen(path) + 1);
    int yes = connect(s, (struct sockaddr *)&a, sizeof a) == 0 || errno == EAGAIN;
    close(s);
    return yes;
}

pvx_err pvp_ipc_claim_new(const char *endpoint, pvp_ipc_claim **out, struct pvx_diag *d)
{
    *out = NULL;
    if (strncmp(endpoint, "ipc://", 6) != 0)
        return PVX_OK;
    const char *path = endpoint + 6;
    if (path[0] == '@' || path[0] == '*' || path[0] == '\0')
        return PVX_OK;
    struct pvp_ipc_claim *c = calloc(1, sizeof *c);
    PVX_NEED(c);
    if (strlen(path) >= sizeof c->path) {
        free(c);
        return pvx_fail(d, PVX_EINVAL, "%s: path longer than the %zu bytes a socket may have",
                        endpoint, sizeof c->path - 1);
    }
    memcpy(c->path, path, strlen(path) + 1);
    snprintf(c->lock, sizeof c->lock, "%s.lock", path);
    pvx_err e = get_lock(c, endpoint, d);
    if (e != PVX_OK) {
        free(c);
        return e;
    }
    if (somebody_listens(c->path)) {
        unlink(c->lock);
        close(c->fd);
        free(c);
        return busy(endpoint, 0, d);
    }
    char pid[24];
    int n = snprintf(pid, sizeof pid, "%ld\n", (long)getpid());
    /* The pid is only for the message to a second daemon; a full disk does not prevent the start. */
    if (ftruncate(c->fd, 0) != 0 || pwrite(c->fd, pid, (size_t)n, 0) != n)
        errno = 0;
    *out = c;
    return PVX_OK;
}

void pvp_ipc_claim_free(pvp_ipc_claim **c)
{
    if (*c == NULL)
        return;
    unlink((*c)->path);
    unlink((*c)->lock);
    close((*c)->fd);
    free(*c);
    *c = NULL;
}
