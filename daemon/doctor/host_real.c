/* host_real.c - answers of this host that are in no file. */
#include <endian.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/capability.h>
#include <linux/ethtool.h>
#include <linux/net_tstamp.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <sys/timex.h>
#include <sys/wait.h>
#include <sys/xattr.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "daemon/doctor/host.h"

#define RUN_NS (5 * PVX_NS_PER_S) /* patience with a command */

static bool host_real_ask(int fd, const char *ifname, void *cmd)
{
    struct ifreq r = {0};
    snprintf(r.ifr_name, sizeof r.ifr_name, "%s", ifname);
    r.ifr_data = cmd;
    return ioctl(fd, SIOCETHTOOL, &r) == 0;
}

void doc_real_nic(struct doc_host *h, const char *ifname, struct doc_nic *out)
{
    (void)h;
    *out = (struct doc_nic){.phc = -1};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return;
    struct ethtool_ringparam ring = {.cmd = ETHTOOL_GRINGPARAM};
    if (host_real_ask(fd, ifname, &ring) && ring.rx_max_pending > 0) {
        out->ring_known = true;
        out->rx_ring = ring.rx_pending;
        out->rx_ring_max = ring.rx_max_pending;
    }
    struct ethtool_pauseparam pause_ = {.cmd = ETHTOOL_GPAUSEPARAM};
    if (host_real_ask(fd, ifname, &pause_)) {
        out->pause_known = true;
        out->tx_pause = pause_.tx_pause;
    }
    struct ethtool_coalesce co = {.cmd = ETHTOOL_GCOALESCE};
    if (host_real_ask(fd, ifname, &co)) {
        out->coalesce_known = true;
        out->adaptive_rx = co.use_adaptive_rx_coalesce;
        out->rx_usecs = co.rx_coalesce_usecs;
        out->rx_frames = co.rx_max_coalesced_frames;
    }
    struct ethtool_ts_info ts = {.cmd = ETHTOOL_GET_TS_INFO};
    if (host_real_ask(fd, ifname, &ts)) {
        const unsigned hw = SOF_TIMESTAMPING_TX_HARDWARE | SOF_TIMESTAMPING_RX_HARDWARE |
                            SOF_TIMESTAMPING_RAW_HARDWARE;
        out->stamp_known = true;
        out->hw_stamps = (ts.so_timestamping & hw) == hw;
        out->phc = ts.phc_index;
    }
    struct ethtool_eee eee = {.cmd = ETHTOOL_GEEE};
    if (host_real_ask(fd, ifname, &eee)) {
        out->eee_known = true;
        out->eee_active = eee.eee_active;
    }
    close(fd);
}

static void real_clock(struct doc_host *h, struct doc_clock *out)
{
    (void)h;
    struct timex t = {0};
    int state = adjtimex(&t);
    *out = (struct doc_clock){.known = state >= 0,
                              .synchronized =
                                  state >= 0 && state != TIME_ERROR && (t.status & STA_UNSYNC) == 0,
                              .max_error_s = (double)t.maxerror * 1e-6};
}

/* In the child: its two outputs become the pipes, and only this environment is left. */
static void host_real_become(const char *const *argv, const int out[2], const int err[2])
{
    static char path[] = "PATH=/usr/sbin:/sbin:/usr/bin:/bin", locale[] = "LC_ALL=C";
    static char *const env[] = {path, locale, NULL};
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(out[1], STDOUT_FILENO);
    dup2(err[1], STDERR_FILENO);
    signal(SIGINT, SIG_DFL);
    execvpe(argv[0], (char *const *)(uintptr_t)argv, env);
    _exit(errno == ENOENT ? 127 : 126);
}

/* Read both pipes to their ends or until the time is up. */
static bool host_real_collect(int out_fd, int err_fd, char *out, size_t size, char *err,
                              size_t err_size)
{
    int64_t until = pvx_now_mono() + RUN_NS;
    struct pollfd p[2] = {{.fd = out_fd, .events = POLLIN}, {.fd = err_fd, .events = POLLIN}};
    char *to[2] = {out, err};
    size_t room[2] = {size - 1, err_size - 1};
    char sink[4096];
    while (p[0].fd >= 0 || p[1].fd >= 0) {
        int64_t left = until - pvx_now_mono();
        if (left <= 0 || (poll(p, 2, (int)(left / PVX_NS_PER_MS) + 1) < 0 && errno != EINTR))
            break;
        for (int i = 0; i < 2; i++) {
            if (p[i].fd < 0 || p[i].revents == 0)
                continue;
            ssize_t n =
                room[i] > 0 ? read(p[i].fd, to[i], room[i]) : read(p[i].fd, sink, sizeof sink);
            if (n <= 0) {
                p[i].fd = -1;
            } else if (room[i] > 0) {
                to[i] += n;
                room[i] -= (size_t)n;
            }
        }
    }
    *to[0] = '\0';
    *to[1] = '\0';
    return p[0].fd < 0 && p[1].fd < 0;
}

pvx_err doc_real_run(struct doc_host *h, const char *const *argv, char *out, size_t size,
                     struct pvx_diag *d)
{
    (void)h;
    int o[2], e[2], status = -1;
    char err[300] = "";
    out[0] = '\0';
    if (pipe2(o, O_CLOEXEC) != 0)
        return pvx_fail(d, PVX_EIO, "%s: no pipe: %s", argv[0], strerror(errno));
    if (pipe2(e, O_CLOEXEC) != 0) {
        close(o[0]);
        close(o[1]);
        return pvx_fail(d, PVX_EIO, "%s: no pipe: %s", argv[0], strerror(errno));
    }
    pid_t pid = fork();
    if (pid == 0)
        host_real_become(argv, o, e);
    close(o[1]);
    close(e[1]);
    bool whole = pid > 0 && host_real_collect(o[0], e[0], out, size, err, sizeof err);
    close(o[0]);
    close(e[0]);
    if (pid < 0)
        return pvx_fail(d, PVX_EIO, "%s: no process: %s", argv[0], strerror(errno));
    if (!whole)
        kill(pid, SIGKILL);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    if (!whole)
        return pvx_fail(d, PVX_ETIMEDOUT, "%s did not answer in 5 s", argv[0]);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return PVX_OK;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
        return pvx_fail(d, PVX_ENOENT, "%s is not installed", argv[0]);
    err[strcspn(err, "\n")] = '\0';
    bool perm = strstr(err, "ermi") != NULL || strstr(err, "root") != NULL;
    return pvx_fail(d, perm ? PVX_EPERM : PVX_EIO, "%s: %s", argv[0],
                    err[0] != '\0' ? err : "failed");
}

static bool real_space(struct doc_host *h, const char *path, double *free_bytes)
{
    (void)h;
    struct statvfs s;
    if (statvfs(path, &s) != 0)
        return false;
    *free_bytes = (double)s.f_bavail * (double)s.f_frsize;
    return true;
}

static bool real_file_caps(struct doc_host *h, const char *path, uint64_t *permitted)
{
    (void)h;
    struct vfs_ns_cap_data v; /* the longest; its end may be missing */
    if (getxattr(path, "security.capability", &v, sizeof v) < (ssize_t)XATTR_CAPS_SZ_2)
        return false;
    *permitted = (uint64_t)le32toh(v.data[1].permitted) << 32 | le32toh(v.data[0].permitted);
    return true;
}

static void real_wait(struct doc_host *h, double seconds)
{
    (void)h;
    pvx_sleep_until_mono(pvx_now_mono() + (int64_t)(seconds * 1e9));
}

void doc_host_init(struct doc_host *h)
{
    static char dir[4096];
    if (pvx_exe_dir(dir, sizeof dir) != PVX_OK)
        dir[0] = '\0';
    *h = (struct doc_host){.root = "",
                           .nic = doc_real_nic,
                           .clock = real_clock,
                           .run = doc_real_run,
                           .space = real_space,
                           .file_caps = real_file_caps,
                           .cards = doc_real_cards,
                           .wait = real_wait,
                           .sample_s = 1,
                           .exe_dir = dir};
}
