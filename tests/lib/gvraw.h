/* gvraw.h - the least of a GigE Vision client: one socket for commands, one for the stream, and every
 * packet as it came. */
#ifndef GVRAW_H
#define GVRAW_H
#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>

#include "capture/wire/be.h"
#include "capture/gevsim/feature.h"
#include "capture/wire/gvcp.h"
#include "tests/lib/gvclient.h"
#include "tests/lib/gvsp_read.h"

struct raw {
    int control, stream;
    struct sockaddr_in to; /* the camera's control port */
    uint16_t id;
    uint8_t ack[2048];
    struct cap_gvcp_answer a; /* the last acknowledge */
};

static int raw_socket(const char *address)
{
    struct sockaddr_in sa = {.sin_family = AF_INET};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), yes = 1, room = 4 << 20;
    inet_pton(AF_INET, address, &sa.sin_addr);
    T_OK(fd >= 0 && bind(fd, (struct sockaddr *)&sa, sizeof sa) == 0);
    setsockopt(fd, SOL_SOCKET, SO_BROADCAST, &yes, sizeof yes);
    setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &yes, sizeof yes);
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
    return fd;
}

static void raw_open(struct raw *r, const char *camera)
{
    memset(r, 0, sizeof *r);
    r->control = raw_socket("127.0.0.1");
    r->stream = raw_socket("127.0.0.1");
    r->to = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT)};
    inet_pton(AF_INET, camera, &r->to.sin_addr);
}

static void raw_close(struct raw *r)
{
    close(r->control);
    close(r->stream);
}

static inline uint32_t feature(enum gvcam_feature f)
{
    return GVF_ADDRESS(f);
}

static bool raw_wait(int fd, int ms)
{
    struct pollfd p = {.fd = fd, .events = POLLIN};
    return poll(&p, 1, ms) > 0;
}

/* The next acknowledge within ms; false = none. */
static bool raw_ack(struct raw *r, int ms, struct sockaddr_in *from)
{
    struct sockaddr_in sa;
    socklen_t len = sizeof sa;
    if (!raw_wait(r->control, ms))
        return false;
    ssize_t n = recvfrom(r->control, r->ack, sizeof r->ack, 0, (struct sockaddr *)&sa, &len);
    if (from != NULL)
        *from = sa;
    return n >= 0 && cap_gvcp_parse_ack(r->ack, (size_t)n, &r->a);
}

static void raw_send(const struct raw *r, const void *p, size_t n)
{
    T_EQ_I(sendto(r->control, p, n, 0, (const struct sockaddr *)&r->to, sizeof r->to), n);
}

/* Command and acknowledge, asked for again as the protocol has it; the status, or CAP_GVCP_SILENT. */
static uint16_t raw_command(struct raw *r, uint16_t command, const void *data, size_t n)
{
    uint8_t p[CAP_GVCP_MAX];
    r->id = r->id == 65535 ? 1 : (uint16_t)(r->id + 1);
    size_t bytes = cap_gvcp_put_command(p, CAP_GVCP_ACK, command, r->id, data, n);
    for (int k = 0; k < 10; k++) {
        raw_send(r, p, bytes);
        while (raw_ack(r, 1000, NULL))
            if (r->a.id == r->id && r->a.command == command + 1)
                return r->a.status;
    }
    return CAP_GVCP_SILENT;
}

static uint16_t raw_write(struct raw *r, uint32_t address, uint32_t value)
{
    uint8_t d[8];
    cap_put32(d, address);
    cap_put32(d + 4, value);
    return raw_command(r, CAP_GVCP_WRITEREG, d, 8);
}

/* Control is given back. */
static inline void raw_leave(struct raw *r)
{
    T_EQ_I(raw_write(r, GVB_CCP, 0), CAP_GVCP_OK);
    raw_close(r);
}

/* 0 and a failed check when it cannot be read. */
static inline uint32_t raw_read(struct raw *r, uint32_t address)
{
    uint8_t d[4];
    cap_put32(d, address);
    T_EQ_I(raw_command(r, CAP_GVCP_READREG, d, 4), CAP_GVCP_OK);
    T_EQ_I(r->a.n, 4);
    return r->a.n == 4 ? cap_get32(r->a.data) : 0;
}

static inline uint64_t raw_read64(struct raw *r, uint32_t address)
{
    uint8_t d[8];
    cap_put32(d, address);
    cap_put32(d + 4, 8);
    T_EQ_I(raw_command(r, CAP_GVCP_READMEM, d, 8), CAP_GVCP_OK);
    T_EQ_I(r->a.n, 12);
    return r->a.n == 12 ? cap_get64(r->a.data + 4) : 0;
}

static inline uint32_t raw_float(float f)
{
    uint32_t u;
    memcpy(&u, &f, 4);
    return u;
}

/* Control, a heartbeat that outlasts the test, stream to our socket, small Mono8 frames. */
static inline void raw_prepare(struct raw *r, uint32_t w, uint32_t h, uint32_t packet)
{
    struct sockaddr_in sa = {0};
    socklen_t len = sizeof sa;
    getsockname(r->stream, (struct sockaddr *)&sa, &len);
    T_EQ_I(raw_write(r, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, GVB_HEARTBEAT, 600000), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, feature(GVF_WIDTH), w), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, feature(GVF_HEIGHT), h), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, feature(GVF_PIXEL_FORMAT), cap_pixfmt_pfnc(CAP_GREY8)), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, GVB_SCPS, packet), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, GVB_SCDA, 0x7f000001), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, GVB_SCP, ntohs(sa.sin_port)), CAP_GVCP_OK);
}

static inline void raw_start(struct raw *r)
{
    T_EQ_I(raw_write(r, feature(GVF_ACQ_START), 1), CAP_GVCP_OK);
}

static inline void raw_stop(struct raw *r)
{
    T_EQ_I(raw_write(r, feature(GVF_ACQ_STOP), 1), CAP_GVCP_OK);
}

/* Trigger mode with this source (enum of the feature); no limit from the exposure. */
static inline void raw_triggered(struct raw *r, uint32_t source)
{
    T_EQ_I(raw_write(r, feature(GVF_TRIGGER_MODE), 1), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, feature(GVF_TRIGGER_SOURCE), source), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, feature(GVF_EXPOSURE), raw_float(10)), CAP_GVCP_OK);
}

struct packet {
    struct cap_gvsp_head h;
    struct cap_gvsp_leader l; /* of a leader */
    size_t bytes;
    int64_t at; /* when the kernel got it */
    uint8_t data[20000];
    size_t head;
};

/* The next packet of the stream within ms. */
static inline bool raw_packet(struct raw *r, int ms, struct packet *p)
{
    char control[CMSG_SPACE(sizeof(struct timespec))];
    struct iovec iov = {p->data, sizeof p->data};
    struct msghdr m = {
        .msg_iov = &iov, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
    if (!raw_wait(r->stream, ms))
        return false;
    ssize_t n = recvmsg(r->stream, &m, 0);
    if (n < 0)
        return false;
    p->bytes = (size_t)n;
    p->head = gvsp_head(p->data, p->bytes, &p->h);
    p->at = 0;
    for (struct cmsghdr *c = CMSG_FIRSTHDR(&m); c != NULL; c = CMSG_NXTHDR(&m, c))
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SCM_TIMESTAMPNS) {
            struct timespec ts;
            memcpy(&ts, CMSG_DATA(c), sizeof ts);
            p->at = ts.tv_sec * PVX_NS_PER_S + ts.tv_nsec;
        }
    if (p->head == 0)
        return true;
    gvsp_leader(p->data + p->head, p->bytes - p->head, &p->l);
    return true;
}

/* The next leader. */
static inline bool raw_leader(struct raw *r, struct packet *p)
{
    UNTIL (false)
        if (raw_packet(r, 1000, p) && p->head > 0 && p->h.content == CAP_GVSP_LEAD)
            return true;
    return false;
}

static inline void raw_drain(struct raw *r)
{
    struct packet p;
    while (raw_packet(r, 0, &p))
        ;
    while (raw_ack(r, 0, NULL))
        ;
}
#endif
