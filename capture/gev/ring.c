#include "capture/gev/ring.h"

#include <dirent.h>
#include <linux/filter.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>

#include "base/clock.h"

/* The kernel hands a block over 5 ms, and at most two of its ticks, after the first packet. */
#define REST_NS     (PVX_NS_PER_S / 20)
#define GIVE_UP_NS  (10 * PVX_NS_PER_S)
#define PROGRAM_MAX 64

/* Whether fd is a packet socket that passes packets to this port: its filter contains the number. */
static bool is_ring_of(int fd, uint16_t port)
{
    struct sock_filter program[PROGRAM_MAX];
    int domain = 0;
    socklen_t size = sizeof domain, n = PROGRAM_MAX; /* instructions, not bytes */
    if (getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size) != 0 || domain != AF_PACKET ||
        getsockopt(fd, SOL_SOCKET, SO_GET_FILTER, program, &n) != 0)
        return false;
    for (socklen_t k = 0; k < n; k++)
        if (program[k].code == (BPF_JMP | BPF_JEQ | BPF_K) && program[k].k == port)
            return true;
    return false;
}

static int find_ring(uint16_t port)
{
    int found = -1;
    DIR *d = opendir("/proc/self/fd");
    for (struct dirent *e; found < 0 && d != NULL && (e = readdir(d)) != NULL;) {
        int fd = atoi(e->d_name);
        if (e->d_name[0] != '.' && is_ring_of(fd, port))
            found = fd;
    }
    if (d != NULL)
        closedir(d);
    return found;
}

bool aravis_ring_settle(ArvStream *stream)
{
    struct pollfd p = {.fd = find_ring(arv_gv_stream_get_port(ARV_GV_STREAM(stream))),
                       .events = POLLIN};
    if (p.fd < 0)
        return true;
    int64_t until = pvx_now_mono() + GIVE_UP_NS;
    /* Readable: the thread has not given back a block yet. */
    do
        pvx_sleep_until_mono(pvx_now_mono() + REST_NS);
    while (poll(&p, 1, 0) > 0 && pvx_now_mono() < until);
    return p.revents == 0;
}
