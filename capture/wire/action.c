#include "capture/wire/action.h"

#include <arpa/inet.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/mem.h"
#include "capture/wire/gvcp.h"

#define MOST 256 /* datagrams read per call */

struct cap_action_sender {
    int fd;
};

size_t cap_action_encode(const struct cap_action_keys *k, uint16_t number, int64_t at_ns,
                         bool answer, uint8_t out[CAP_ACTION_BYTES])
{
    bool scheduled = at_ns > 0;
    struct cap_gvcp_action a = {.device_key = k->device_key,
                                .group_key = k->group_key,
                                .group_mask = k->group_mask,
                                .scheduled = scheduled,
                                .time = scheduled ? (uint64_t)at_ns : 0};
    return cap_gvcp_put_action(out, &a, answer, number);
}

bool cap_action_decode(const uint8_t *p, size_t n, struct cap_action_ack *out)
{
    struct cap_gvcp_answer a;
    if (!cap_gvcp_parse_ack(p, n, &a) || a.command != CAP_GVCP_ACTION + 1 || a.id == 0)
        return false;
    out->status = a.status;
    out->number = a.id;
    return true;
}

pvx_err cap_action_sender_new(cap_action_sender **out, struct pvx_diag *d)
{
    *out = NULL;
    cap_action_sender *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    int on = 1;
    s->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (s->fd < 0 || setsockopt(s->fd, SOL_SOCKET, SO_BROADCAST, &on, sizeof on) != 0) {
        pvx_err e = pvx_fail(d, PVX_EIO, "socket for action commands: %s", strerror(errno));
        cap_action_sender_free(&s);
        return e;
    }
    *out = s;
    return PVX_OK;
}

void cap_action_sender_free(cap_action_sender **s)
{
    if (*s == NULL)
        return;
    if ((*s)->fd >= 0)
        close((*s)->fd);
    free(*s);
    *s = NULL;
}

int cap_action_sender_fd(const cap_action_sender *s)
{
    return s->fd;
}

pvx_err cap_action_send(cap_action_sender *s, uint32_t address, const uint8_t *p, size_t n)
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT)};
    to.sin_addr.s_addr = htonl(address);
    ssize_t sent = sendto(s->fd, p, n, 0, (const struct sockaddr *)&to, sizeof to);
    return sent == (ssize_t)n ? PVX_OK : PVX_EIO;
}

bool cap_action_answer(cap_action_sender *s, uint32_t *from, struct cap_action_ack *out)
{
    for (int i = 0; i < MOST; i++) { /* bounded, because a sender may never stop */
        uint8_t p[64];
        struct sockaddr_in sa = {0};
        socklen_t len = sizeof sa;
        ssize_t n = recvfrom(s->fd, p, sizeof p, 0, (struct sockaddr *)&sa, &len);
        if (n < 0 && errno != EINTR && errno != ECONNREFUSED)
            return false;
        if (n >= 0 && len == sizeof sa && cap_action_decode(p, (size_t)n, out)) {
            *from = ntohl(sa.sin_addr.s_addr);
            return true;
        }
    }
    return false;
}
