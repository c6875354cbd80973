/* host.c - what the host grants to the receiving threads: priority, and room for packets.
 *
 * The host may refuse both.  Without them cameras work until the machine is busy.  So a refusal is a warning with its
 * remedy.  It is logged once in a process, because it is the same for all cameras. */
#include "capture/gev/host.h"

#include <arv.h>
#include <stdatomic.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/log.h"

#define RT_PRIORITY 10 /* for 0 in cap_gige */

void aravis_make_realtime(const struct cap_source_config *c)
{
    static atomic_flag said = ATOMIC_FLAG_INIT;
    int priority = c->gige.rt_priority > 0 ? c->gige.rt_priority : RT_PRIORITY;
    if (c->gige.rt_priority < 0 || arv_make_thread_realtime(priority) ||
        atomic_flag_test_and_set(&said))
        return;
    LOG_W(CAPTURE,
          "camera %s: its receiving thread gets no real-time priority (gige.rt_priority %d): on a "
          "busy machine packets may be lost. Remedy: run as the service or raise the limit rtprio "
          "(`pyrovox doctor` says how), or gige.rt_priority: 0 to do without",
          c->name, priority);
}

/* Whether this process may use a packet socket, which bypasses the sockets' buffers.  Aravis tries the same. */
static bool packet_socket(const struct cap_source_config *c)
{
    int fd = c->gige.no_packet_socket ? -1 : socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
    if (fd >= 0)
        close(fd);
    return fd >= 0;
}

/* Receive buffer of a socket that asks for this many bytes; the kernel doubles the value for its own book-keeping. */
static int host_room(int asked)
{
    int got = 0;
    socklen_t len = sizeof got;
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return asked;
    bool known = setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &asked, sizeof asked) == 0 &&
                 getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &got, &len) == 0;
    close(fd);
    return known ? got / 2 : asked;
}

void aravis_check_room(const struct cap_source_config *c, int asked)
{
    static atomic_flag said = ATOMIC_FLAG_INIT;
    int got = host_room(asked);
    if (got >= asked || packet_socket(c) || atomic_flag_test_and_set(&said))
        return;
    LOG_W(CAPTURE,
          "camera %s: a socket buffer of %d bytes was asked for (gige.socket_buffer), the kernel "
          "gives %d: bursts of packets may be lost. Remedy: sysctl -w net.core.rmem_max=%d "
          "(`pyrovox doctor` makes it last), or a smaller gige.socket_buffer",
          c->name, asked, got, asked);
}
