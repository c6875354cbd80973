#include "daemon/volumes/vdb_child.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon/volumes/vdb_module.h"
#include "proto/pvp.h"

#define CELLS  512
#define KELVIN (CELLS * sizeof(float)) /* of a brick */
#define CPU_S  300
#define MEMORY ((size_t)1 << 30) /* beside what the grid may need */
#define COPIES \
    14 /* of a volume that OpenVDB and the module hold at once: 6, and of its bars, and kelvin */

struct answer {
    int error, bars, kelvin;
    uint32_t n_bricks;
    char text[256];
};

static size_t brick_bytes(const struct vol_vdb_bricks *v)
{
    return (size_t)CELLS * v->channels * sizeof(float);
}

static size_t most_bricks(const struct vol_vdb_bricks *v)
{
    uint32_t nb[3];
    return pvp_grid_bricks(&(struct pvp_grid){.n = {v->n[0], v->n[1], v->n[2]}}, nb);
}

static bool send_all(int fd, const void *data, size_t n)
{
    for (const char *p = data; n > 0;) {
        ssize_t w = write(fd, p, n);
        if (w < 0 && errno != EINTR)
            return false;
        p += w > 0 ? w : 0;
        n -= w > 0 ? (size_t)w : 0;
    }
    return true;
}

static bool receive_all(int fd, void *data, size_t n)
{
    for (char *p = data; n > 0;) {
        ssize_t r = read(fd, p, n);
        if (r == 0 || (r < 0 && errno != EINTR))
            return false;
        p += r > 0 ? r : 0;
        n -= r > 0 ? (size_t)r : 0;
    }
    return true;
}

static void bound(const struct vol_vdb_bricks *v)
{
    const struct rlimit none = {0, 0}, cpu = {CPU_S, CPU_S};
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    setrlimit(RLIMIT_CORE, &none);
    setrlimit(RLIMIT_CPU, &cpu);
#if !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__) /* their shadow is not counted */
    const size_t most = MEMORY + COPIES * most_bricks(v) * brick_bytes(v);
    setrlimit(RLIMIT_DATA, &(struct rlimit){most, most});
#else
    (void)v;
#endif
    static const int crash[] = {SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGABRT};
    for (size_t i = 0; i < sizeof crash / sizeof crash[0]; i++)
        signal(crash[i], SIG_DFL);
    signal(SIGPIPE, SIG_IGN);
    int nowhere =
        open("/dev/null", O_WRONLY | O_CLOEXEC); /* for the library's words about damaged bytes */
    if (nowhere >= 0)
        for (int stream = STDOUT_FILENO; stream <= STDERR_FILENO; stream++)
            dup2(nowhere, stream);
}

/* All that the child process does. */
static void vdb_child_serve(vol_vdb_read_fn *decode, int fd, const void *bytes, size_t len,
                            struct vol_vdb_bricks *v)
{
    struct answer a = {.error = PVX_OK};
    bound(v);
    a.error = decode(bytes, len, v, a.text, sizeof a.text);
    a.n_bricks = a.error == PVX_OK ? v->n_bricks : 0;
    a.bars = a.error == PVX_OK && v->sd != NULL;
    a.kelvin = a.error == PVX_OK && v->kelvin != NULL;
    bool sent = send_all(fd, &a, sizeof a) &&
                (a.error != PVX_OK || (send_all(fd, v->ids, a.n_bricks * sizeof *v->ids) &&
                                       send_all(fd, v->brick, a.n_bricks * brick_bytes(v)))) &&
                (!a.bars || send_all(fd, v->sd, a.n_bricks * brick_bytes(v))) &&
                (!a.kelvin || send_all(fd, v->kelvin, a.n_bricks * KELVIN));
    _exit(sent ? 0 : 1);
}

static bool believable(const struct vol_vdb_bricks *v)
{
    for (uint32_t b = 0; b < v->n_bricks; b++)
        if (v->ids[b] >= most_bricks(v) || (b > 0 && v->ids[b] <= v->ids[b - 1]))
            return false;
    for (size_t i = 0; i < (size_t)v->n_bricks * CELLS * v->channels; i++)
        if (!isfinite(v->brick[i]) || (v->sd != NULL && !(isfinite(v->sd[i]) && v->sd[i] >= 0)))
            return false;
    for (size_t i = 0; i < (size_t)v->n_bricks * CELLS && v->kelvin != NULL; i++)
        if (!(isfinite(v->kelvin[i]) && v->kelvin[i] >= 0))
            return false;
    return true;
}

/* A plane of n bricks; NULL: no memory, or the child has ended. */
static float *receive_plane(int fd, uint32_t n, size_t bytes)
{
    float *brick = calloc(n + (size_t)1, bytes);
    if (brick != NULL && receive_all(fd, brick, n * bytes))
        return brick;
    free(brick);
    return NULL;
}

void vol_vdb_child_free(struct vol_vdb_bricks *v)
{
    free((uint32_t *)v->ids);
    free((float *)v->brick);
    free((float *)v->sd);
    free((float *)v->kelvin);
    v->ids = NULL;
    v->brick = v->sd = v->kelvin = NULL;
    v->n_bricks = 0;
}

static pvx_err vdb_child_receive(int fd, const char *path, struct vol_vdb_bricks *v,
                                 struct pvx_diag *d)
{
    struct answer a;
    if (!receive_all(fd, &a, sizeof a) || a.n_bricks > most_bricks(v))
        return PVX_ECORRUPT;
    a.text[sizeof a.text - 1] = '\0';
    if (a.error != PVX_OK)
        return vol_vdb_error(a.error == PVX_EFORMAT ? PVX_ECORRUPT : a.error, path, a.text, d);
    uint32_t *ids = calloc(a.n_bricks + (size_t)1, sizeof *ids);
    PVX_NEED(ids);
    v->ids = ids;
    v->n_bricks = a.n_bricks;
    bool good = receive_all(fd, ids, a.n_bricks * sizeof *ids) &&
                (v->brick = receive_plane(fd, a.n_bricks, brick_bytes(v))) != NULL &&
                (!a.bars || (v->sd = receive_plane(fd, a.n_bricks, brick_bytes(v))) != NULL) &&
                (!a.kelvin || (v->kelvin = receive_plane(fd, a.n_bricks, KELVIN)) != NULL) &&
                believable(v);
    if (!good)
        vol_vdb_child_free(v);
    return good ? PVX_OK : PVX_ECORRUPT;
}

pvx_err vol_vdb_child_read(vol_vdb_read_fn *decode, const char *path, const void *bytes, size_t len,
                           struct vol_vdb_bricks *v, struct pvx_diag *d)
{
    int fd[2], status;
    if (pipe(fd) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: no pipe to be had", path);
    pid_t pid = fork();
    if (pid == 0) {
        close(fd[0]);
        vdb_child_serve(decode, fd[1], bytes, len, v);
    }
    close(fd[1]);
    pvx_err e = pid > 0 ? vdb_child_receive(fd[0], path, v, d) : PVX_EIO;
    close(fd[0]);
    while (pid > 0 && waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    if (e == PVX_ECORRUPT)
        pvx_fail(d, e,
                 "%s: damaged: it cannot be read; make it again from its recording, or `pyrovox "
                 "repair` its folder",
                 path);
    return e != PVX_OK ? pvx_fail(d, e, "%s: %s", path, pvx_strerror(e)) : PVX_OK;
}
