#include "tests/vm/uvc/usbip.h"

#include <arpa/inet.h>
#include <errno.h>
#include <sys/socket.h>
#include <sys/uio.h>

enum { CMD_SUBMIT = 1, CMD_UNLINK, RET_SUBMIT, RET_UNLINK };
enum { DIR_OUT, DIR_IN };

/* 48 bytes, each word big-endian but the setup packet. */
struct header {
    uint32_t command, seq, devid, direction, endpoint;
    union {
        struct {
            uint32_t flags, length, start_frame, packets, interval;
            uint8_t setup[8];
        } submit;
        struct {
            uint32_t status, actual, start_frame, packets, errors, pad[2];
        } done;
        struct {
            uint32_t seq, pad[6]; /* of the transfer to take back; in the answer: status */
        } unlink;
    };
};
_Static_assert(sizeof(struct header) == 48, "usbip_header is 48 bytes");

static bool read_all(int fd, void *to, size_t n)
{
    for (uint8_t *p = to; n > 0;) {
        ssize_t got = recv(fd, p, n, MSG_WAITALL);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return false;
        p += got;
        n -= (size_t)got;
    }
    return true;
}

static bool write_all(int fd, struct header *h, const void *data, size_t n)
{
    struct iovec v[2] = {{h, sizeof *h}, {(void *)(uintptr_t)data, n}};
    struct msghdr m = {.msg_iov = v, .msg_iovlen = n > 0 ? 2 : 1};
    while (m.msg_iovlen > 0) {
        ssize_t sent = sendmsg(fd, &m, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR)
            continue;
        if (sent <= 0)
            return false;
        while (m.msg_iovlen > 0 && (size_t)sent >= m.msg_iov->iov_len) {
            sent -= (ssize_t)m.msg_iov->iov_len;
            m.msg_iov++;
            m.msg_iovlen--;
        }
        if (m.msg_iovlen > 0) {
            m.msg_iov->iov_base = (uint8_t *)m.msg_iov->iov_base + sent;
            m.msg_iov->iov_len -= (size_t)sent;
        }
    }
    return true;
}

static bool answer_submit(struct usbip *u, uint32_t seq, int status, const void *data,
                          uint32_t actual, bool in)
{
    struct header h = {.command = htonl(RET_SUBMIT), .seq = htonl(seq)};
    h.done.status = htonl((uint32_t)status);
    h.done.actual = htonl(actual);
    return write_all(u->fd, &h, data, in ? actual : 0);
}

static bool answer_unlink(struct usbip *u, uint32_t seq, int status)
{
    struct header h = {.command = htonl(RET_UNLINK), .seq = htonl(seq)};
    h.unlink.seq = htonl((uint32_t)status);
    return write_all(u->fd, &h, NULL, 0);
}

static bool control(struct usbip *u, uint32_t seq, bool in, uint32_t length, const uint8_t *setup)
{
    uint8_t data[USBIP_MAX_OUT] = {0}, answer[USBIP_MAX_ANSWER];
    if (!in && (length > sizeof data || !read_all(u->fd, data, length)))
        return false;
    int n = u->control(u->ctx, setup, data, in ? 0 : length, answer);
    if (n < 0)
        return answer_submit(u, seq, n, NULL, 0, in);
    if (!in)
        return answer_submit(u, seq, 0, NULL, length, false);
    uint32_t wanted = (uint32_t)(setup[6] | setup[7] << 8);
    uint32_t give = (uint32_t)n < wanted ? (uint32_t)n : wanted;
    return answer_submit(u, seq, 0, answer, give < length ? give : length, true);
}

/* Number of the unlink that came before transfer `seq`; 0 = none did. */
static uint32_t unlinked_early(struct usbip *u, uint32_t seq)
{
    for (unsigned i = 0; i < USBIP_MAX_EARLY; i++)
        if (u->early[i].by != 0 && u->early[i].victim == seq) {
            uint32_t by = u->early[i].by;
            u->early[i].by = 0;
            return by;
        }
    return 0;
}

static bool submit(struct usbip *u, const struct header *h)
{
    uint32_t seq = ntohl(h->seq), length = ntohl(h->submit.length);
    uint32_t endpoint = ntohl(h->endpoint);
    bool in = ntohl(h->direction) == DIR_IN;
    u->last_seq = seq;
    u->any = true;
    uint32_t unlink = unlinked_early(u, seq);
    if (unlink != 0) {
        uint8_t waste[USBIP_MAX_OUT];
        if (!in && (length > sizeof waste || !read_all(u->fd, waste, length)))
            return false;
        u->unlinked++;
        return answer_unlink(u, unlink, -ECONNRESET);
    }
    if (endpoint == 0)
        return control(u, seq, in, length, h->submit.setup);
    if (endpoint != 1 || !in)
        return in ? answer_submit(u, seq, -EPIPE, NULL, 0, true) : false;
    if (u->n == USBIP_MAX_QUEUE)
        return answer_submit(u, seq, -ENOMEM, NULL, 0, true);
    u->queue[(u->head + u->n++) % USBIP_MAX_QUEUE] = (struct usbip_transfer){seq, length};
    return true;
}

static bool unlink_transfer(struct usbip *u, uint32_t seq, uint32_t victim)
{
    for (unsigned i = 0; i < u->n; i++)
        if (u->queue[(u->head + i) % USBIP_MAX_QUEUE].seq == victim) {
            for (u->n--; i < u->n; i++)
                u->queue[(u->head + i) % USBIP_MAX_QUEUE] =
                    u->queue[(u->head + i + 1) % USBIP_MAX_QUEUE];
            u->unlinked++;
            return answer_unlink(u, seq, -ECONNRESET);
        }
    if (u->any && (int32_t)(victim - u->last_seq) <= 0)
        return answer_unlink(u, seq, 0);
    for (unsigned i = 0; i < USBIP_MAX_EARLY; i++)
        if (u->early[i].by == 0) {
            u->early[i] = (struct usbip_early){victim, seq};
            return true;
        }
    return false;
}

bool usbip_serve(struct usbip *u)
{
    struct header h;
    if (!read_all(u->fd, &h, sizeof h))
        return false;
    switch (ntohl(h.command)) {
    case CMD_SUBMIT: return submit(u, &h);
    case CMD_UNLINK: return unlink_transfer(u, ntohl(h.seq), ntohl(h.unlink.seq));
    default: return false;
    }
}

size_t usbip_bulk_room(const struct usbip *u)
{
    return u->n > 0 ? u->queue[u->head].room : 0;
}

bool usbip_bulk_answer(struct usbip *u, const void *data, size_t n)
{
    uint32_t seq = u->queue[u->head].seq;
    u->head = (u->head + 1) % USBIP_MAX_QUEUE;
    u->n--;
    return answer_submit(u, seq, 0, data, (uint32_t)n, true);
}
