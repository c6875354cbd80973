#include "capture/action.h"

#include <arpa/inet.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/mem.h"

#define KEY            0x42
#define FLAG_ANSWER    0x01
#define FLAG_SCHEDULED 0x80
#define ACTION_CMD     0x0100u
#define ACTION_ACK     0x0101u
#define MOST           256 /* datagrams looked at per call */

struct cap_action_sender {
    int fd;
};

static void put16(uint8_t *p, uint16_t v)
{
    p[0] = (uint8_t)(v >> 8);
    p[1] = (uint8_t)v;
}

static void put32(uint8_t *p, uint32_t v)
{
    put16(p, (uint16_t)(v >> 16));
    put16(p + 2, (uint16_t)v);
}

static uint16_t get16(const uint8_t *p)
{
    return (uint16_t)(p[0] << 8 | p[1]);
}

size_t cap_action_encode(const struct cap_action_keys *k, uint16_t number, int64_t at_ns,
                         bool answer, uint8_t out[CAP_ACTION_BYTES])
{
    bool scheduled = at_ns > 0;
    out[0] = KEY;
    out[1] = (uint8_t)((answer ? FLAG_ANSWER : 0) | (scheduled ? FLAG_SCHEDULED : 0));
    put16(out + 2, ACTION_CMD);
    put16(out + 4, scheduled ? 20 : 12);
    put16(out + 6, number);
    put32(out + 8, k->device_key);
    put32(out + 12, k->group_key);
    put32(out + 16, k->group_mask);
    if (!scheduled)
        return 20;
    put32(out + 20, (uint32_t)((uint64_t)at_ns >> 32));
    put32(out + 24, (uint32_t)at_ns);
    return 28;
}

bool cap_action_decode(const uint8_t *p, size_t n, struct cap_action_ack *out)
{
    if (n < 8 || get16(p + 2) != ACTION_ACK || get16(p + 6) == 0)
        return false;
    out->status = get16(p);
    out->number = get16(p + 6);
    return true;
}

pvx_err cap_action_sender_new(cap_action_sender **out, struct pvx_diag *d)
{
    *out = NULL;
    cap_action_sender *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return PVX_ENOMEM;
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
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(CAP_ACTION_PORT)};
    to.sin_addr.s_addr = htonl(address);
    ssize_t sent = sendto(s->fd, p, n, 0, (const struct sockaddr *)&to, sizeof to);
    return sent == (ssize_t)n ? PVX_OK : PVX_EIO;
}

bool cap_action_answer(cap_action_sender *s, uint32_t *from, struct cap_action_ack *out)
{
    for (int i = 0; i < MOST; i++) { /* somebody may send for ever */
        uint8_t p[64];
        struct sockaddr_in sa;
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
