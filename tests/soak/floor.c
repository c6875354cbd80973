#include "tests/soak/floor.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"

enum { MAX_CAMERAS = 64, BATCH = 64, PACKET_MAX = 16384 };

static char scrap[BATCH][PACKET_MAX];

static void batch(struct mmsghdr *m, struct iovec *v, size_t packet)
{
    memset(m, 0, BATCH * sizeof *m);
    for (int i = 0; i < BATCH; i++) {
        v[i] = (struct iovec){scrap[i], packet};
        m[i].msg_hdr.msg_iov = &v[i];
        m[i].msg_hdr.msg_iovlen = 1;
    }
}

/* The other process: a frame of every camera at once, at the frame rate. */
static void send_all(const struct sockaddr_in *to, unsigned cameras, size_t frame_bytes, double fps,
                     size_t packet, double seconds)
{
    int fd = socket(AF_INET, SOCK_DGRAM, 0);
    struct mmsghdr m[BATCH];
    struct iovec v[BATCH];
    batch(m, v, packet);
    size_t n = (frame_bytes + packet - 1) / packet;
    for (long k = 0; (double)k < fps * seconds; k++) {
        int64_t next = pvx_now_mono() + (int64_t)(1e9 / fps);
        for (unsigned c = 0; c < cameras; c++) {
            for (int i = 0; i < BATCH; i++) {
                m[i].msg_hdr.msg_name = (void *)(uintptr_t)&to[c];
                m[i].msg_hdr.msg_namelen = sizeof to[c];
            }
            for (size_t left = n; left > 0;) {
                int sent = sendmmsg(fd, m, left < BATCH ? (unsigned)left : BATCH, 0);
                if (sent <= 0)
                    break;
                left -= (size_t)sent;
            }
        }
        int64_t wait = next - pvx_now_mono();
        if (wait > 0)
            usleep((useconds_t)(wait / 1000));
    }
    _exit(0);
}

static double cpu_s(void)
{
    struct rusage r;
    getrusage(RUSAGE_SELF, &r);
    return (double)(r.ru_utime.tv_sec + r.ru_stime.tv_sec) +
           (double)(r.ru_utime.tv_usec + r.ru_stime.tv_usec) * 1e-6;
}

static uint64_t receive(struct pollfd *p, unsigned cameras, size_t packet, int64_t until)
{
    struct mmsghdr m[BATCH];
    struct iovec v[BATCH];
    batch(m, v, packet);
    uint64_t got = 0;
    while (pvx_now_mono() < until) {
        if (poll(p, cameras, 100) <= 0)
            continue;
        for (unsigned c = 0; c < cameras; c++) {
            int n =
                (p[c].revents & POLLIN) != 0 ? recvmmsg(p[c].fd, m, BATCH, MSG_DONTWAIT, NULL) : 0;
            got += n > 0 ? (uint64_t)n : 0;
        }
    }
    return got;
}

pvx_err receive_floor_measure(unsigned cameras, size_t frame_bytes, double fps, size_t packet,
                              double seconds, struct receive_floor *out, struct pvx_diag *d)
{
    struct sockaddr_in to[MAX_CAMERAS];
    struct pollfd p[MAX_CAMERAS];
    if (cameras < 1 || cameras > MAX_CAMERAS || packet < 1 || packet > PACKET_MAX)
        return PVX_EINVAL;
    for (unsigned c = 0; c < cameras; c++) {
        int size = 8 << 20;
        socklen_t len = sizeof to[c];
        to[c] =
            (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
        p[c] =
            (struct pollfd){.fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), .events = POLLIN};
        if (setsockopt(p[c].fd, SOL_SOCKET, SO_RCVBUFFORCE, &size, sizeof size) != 0)
            setsockopt(p[c].fd, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
        if (p[c].fd < 0 || bind(p[c].fd, (struct sockaddr *)&to[c], len) != 0 ||
            getsockname(p[c].fd, (struct sockaddr *)&to[c], &len) != 0)
            return pvx_fail(d, PVX_EIO, "loopback socket: %s", strerror(errno));
    }
    pid_t pid = fork();
    if (pid < 0)
        return pvx_fail(d, PVX_EIO, "fork: %s", strerror(errno));
    if (pid == 0)
        send_all(to, cameras, frame_bytes, fps, packet, seconds);
    double cpu0 = cpu_s();
    uint64_t got = receive(p, cameras, packet, pvx_now_mono() + (int64_t)(seconds * 1e9));
    out->cpu = (cpu_s() - cpu0) / seconds;
    out->received = (double)got / ((double)((frame_bytes + packet - 1) / packet) *
                                   (double)(long)(fps * seconds) * cameras);
    kill(pid, SIGTERM);
    waitpid(pid, NULL, 0);
    for (unsigned c = 0; c < cameras; c++)
        close(p[c].fd);
    return PVX_OK;
}
