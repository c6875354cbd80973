/* send.c - sends frames: packets, delays, losses, and resending on request. */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/gevsim/gevsim.h"

/* Packets gathered for one system call. */
struct batch {
    struct mmsghdr msg[GVCAM_BATCH];
    struct iovec iov[GVCAM_BATCH][4];
    uint8_t head[GVCAM_BATCH][CAP_GVSP_HEAD_WIDE + CAP_GVSP_LEADER];
    struct sockaddr_in to;
    unsigned n;
};
#define ETHERNET     38                  /* bytes around a packet on the cable */
#define CATCH_UP_NS  (4 * PVX_NS_PER_MS) /* that a late thread may send at once */
#define MAX_PAUSE_NS (2 * PVX_NS_PER_S)  /* a longer pause means that the clock was set back */
static const uint8_t garbage[512];       /* the end of a packet that is too long */

static struct sockaddr_in target(const struct cap_gvcam *c)
{
    return (struct sockaddr_in){.sin_family = AF_INET,
                                .sin_port = htons((uint16_t)c->reg.v[GVF_SCP_PORT]),
                                .sin_addr.s_addr = htonl(c->reg.v[GVF_SCDA])};
}

static uint32_t head_bytes(const struct cap_gvcam *c)
{
    return c->send.wide ? CAP_GVSP_HEAD_WIDE : CAP_GVSP_HEAD;
}

static uint32_t per_packet(const struct cap_gvcam *c)
{
    return c->reg.v[GVF_SCPS] - CAP_GVSP_UDP_IP - head_bytes(c);
}

uint32_t gvcam_payload(const struct cap_gvcam *c)
{
    enum cap_pixfmt f = cap_pixfmt_from_pfnc(c->reg.v[GVF_PIXEL_FORMAT]);
    size_t n = cap_pixfmt_row(f, (int32_t)c->reg.v[GVF_WIDTH]) * c->reg.v[GVF_HEIGHT];
    if (c->reg.v[GVF_CHUNK_MODE] != 0)
        n += gvcam_chunks_max(c);
    return (uint32_t)n;
}

void gvcam_send_start(struct cap_gvcam *c)
{
    gvcam_send_forget(c);
    c->send.wide = c->reg.v[GVF_WIDE_IDS] != 0;
    c->send.chunks = c->reg.v[GVF_CHUNK_MODE] != 0;
}

bool gvcam_send_queue(struct cap_gvcam *c, const struct gvcam_shot *s)
{
    if (c->send.q_n == GVCAM_QUEUE)
        return false;
    c->send.queue[(c->send.q_first + c->send.q_n++) % GVCAM_QUEUE] = *s;
    return true;
}

void gvcam_send_forget(struct cap_gvcam *c)
{
    c->send.q_first = c->send.q_n = 0;
    c->send.cur = NULL;
    for (size_t k = 0; k < GVCAM_HISTORY; k++)
        c->send.history[k].used = false;
}

/* ---- one packet ------------------------------------------------------------------------------- */

static uint16_t payload_type(const struct cap_gvcam *c)
{
    return !c->send.chunks                   ? CAP_GVSP_IMAGE
           : c->reg.v[GVF_CHUNK_LAYOUT] == 0 ? CAP_GVSP_IMAGE_CHUNK
                                             : CAP_GVSP_EXTENDED_CHUNK;
}

static size_t put_leader(const struct cap_gvcam *c, const struct gvcam_sent *s, uint8_t *out)
{
    struct cap_gvsp_leader l = {.payload = payload_type(c),
                                .ticks = s->shot.ticks,
                                .pixel_format = cap_pixfmt_pfnc(c->image.fmt),
                                .width = c->image.region[0] + (s->shot.wrong == 1 ? 8 : 0),
                                .height = c->image.region[1],
                                .x = c->image.region[2],
                                .y = c->image.region[3]};
    return cap_gvsp_put_leader(out, &l);
}

/* The bytes [at, at + n) of image and chunks, as one or two pieces. */
static unsigned put_data(const struct gvcam_sent *s, size_t at, size_t n, struct iovec *iov)
{
    unsigned k = 0;
    if (at < s->image_bytes) {
        size_t m = s->image_bytes - at < n ? s->image_bytes - at : n;
        iov[k++] = (struct iovec){(void *)(uintptr_t)(s->image + at), m};
        at += m;
        n -= m;
    }
    if (n > 0)
        iov[k++] = (struct iovec){(void *)(uintptr_t)(s->tail + (at - s->image_bytes)), n};
    return k;
}

/* Packet number p of frame s as message k of the batch. */
static void send_build(struct cap_gvcam *c, struct gvcam_sent *s, uint32_t p, uint16_t status,
                       struct batch *b, unsigned k)
{
    struct cap_gvsp_head h = {
        .status = status, .wide = c->send.wide, .block = s->shot.id, .packet = p};
    struct iovec *iov = b->iov[k];
    unsigned n_iov = 1;
    h.content = p == 0 ? CAP_GVSP_LEAD : p == s->n_data + 1 ? CAP_GVSP_TRAIL : CAP_GVSP_DATA;
    size_t n = cap_gvsp_put_head(b->head[k], &h);
    if (p == 0) {
        n += put_leader(c, s, b->head[k] + n);
    } else if (p == s->n_data + 1) {
        n += cap_gvsp_put_trailer(
            b->head[k] + n, payload_type(c),
            (uint32_t)(s->image_bytes / (c->image.frame_bytes / c->image.region[1])),
            (uint32_t)s->tail_bytes);
    } else {
        size_t at = (size_t)(p - 1) * s->per_packet, all = s->image_bytes + s->tail_bytes;
        n_iov += put_data(s, at, all - at < s->per_packet ? all - at : s->per_packet, iov + 1);
    }
    iov[0] = (struct iovec){b->head[k], n};
    if (s->shot.corrupt != 0 && p == 1 + s->n_data / 2) {
        if (s->shot.corrupt == 1) { /* a packet number far outside, and another kind */
            b->head[k][4] = (uint8_t)(b->head[k][4] ^ 0x05);
            b->head[k][5] = 0x7f;
        } else {
            iov[n_iov++] = (struct iovec){(void *)(uintptr_t)garbage, sizeof garbage};
        }
    }
    b->msg[k] = (struct mmsghdr){
        .msg_hdr = {
            .msg_name = &b->to, .msg_namelen = sizeof b->to, .msg_iov = iov, .msg_iovlen = n_iov}};
}

static size_t message_bytes(const struct batch *b, unsigned k)
{
    size_t n = CAP_GVSP_UDP_IP;
    for (size_t j = 0; j < b->msg[k].msg_hdr.msg_iovlen; j++)
        n += b->msg[k].msg_hdr.msg_iov[j].iov_len;
    return n;
}

static void flush(struct cap_gvcam *c, struct batch *b)
{
    unsigned tries = 0;
    for (unsigned k = 0; k < b->n;) {
        int sent = sendmmsg(c->send.fd, b->msg + k, b->n - k, MSG_DONTWAIT);
        if (sent > 0) {
            c->stats.packets += (unsigned)sent;
            k += (unsigned)sent;
        } else if ((errno == EAGAIN || errno == EINTR || errno == ENOBUFS) && tries++ < 3) {
            struct pollfd p = {.fd = c->send.fd, .events = POLLOUT};
            (void)poll(&p, 1, 2);
        } else {
            c->stats.send_errors++;
            k++;
        }
    }
    b->n = 0;
}

/* Lose the packet, have the switch cut it, or put it into the batch. */
static void offer(struct cap_gvcam *c, struct gvcam_sent *s, uint32_t p, uint16_t status,
                  struct batch *b, int64_t now)
{
    send_build(c, s, p, status, b, b->n);
    if (gvcam_chance(c, c->fault.packet_loss)) {
        c->stats.lost++;
        s->torn = true;
    } else if (!gvcam_link_pass(c->link, message_bytes(b, b->n), now, &c->stats.cut)) {
        s->torn = true;
    } else {
        b->n++;
    }
}

/* ---- frames ----------------------------------------------------------------------------------- */

/* Renew image k if needed.  Then remembered frames that showed it are no longer valid. */
static void send_renew(struct cap_gvcam *c, size_t k)
{
    if (c->c.renew == NULL || !c->c.renew(c->c.renew_ctx, k, &c->fault.optics))
        return;
    PVX_FREE(c->image.conv[k]);
    for (size_t i = 0; i < GVCAM_HISTORY; i++)
        if (c->send.history[i].used && gvcam_image_number(c, c->send.history[i].shot.index) == k)
            c->send.history[i].used = false;
}

static void send_prepare(struct cap_gvcam *c, struct gvcam_sent *s, const struct gvcam_shot *shot)
{
    send_renew(c, gvcam_image_number(c, shot->index));
    *s = (struct gvcam_sent){.shot = *shot, .used = true};
    s->image = gvcam_image_of(c, shot->index);
    s->image_bytes = s->image != NULL ? c->image.frame_bytes : 0;
    if (shot->wrong == 2) /* the sensor stopped: only the upper half */
        s->image_bytes = s->image_bytes / c->image.region[1] * ((c->image.region[1] + 1) / 2);
    s->tail_bytes = c->send.chunks ? gvcam_chunks(c, shot, s->tail) : 0;
    s->per_packet = per_packet(c);
    s->n_data = (uint32_t)((s->image_bytes + s->tail_bytes + s->per_packet - 1) / s->per_packet);
}

static bool send_next_frame(struct cap_gvcam *c, int64_t now)
{
    const struct gvcam_shot *shot = &c->send.queue[c->send.q_first];
    if (c->send.q_n == 0 || shot->send_at > now)
        return false;
    c->send.q_first = (c->send.q_first + 1) % GVCAM_QUEUE;
    c->send.q_n--;
    c->send.cur = &c->send.history[c->send.h_next];
    c->send.h_next = (c->send.h_next + 1) % GVCAM_HISTORY;
    send_prepare(c, c->send.cur, shot);
    if (shot->hostile) {
        struct sockaddr_in to = target(c);
        gvcam_hostile_packets(c, shot, &to);
    }
    return true;
}

static void send_finish(struct cap_gvcam *c)
{
    const struct gvcam_sent *s = c->send.cur;
    c->stats.frames++;
    c->stats.torn += s->torn;
    c->stats.wrong_size += s->shot.wrong != 0;
    c->stats.corrupt += s->shot.corrupt != 0;
    c->send.cur = NULL;
}

/* The order in which the next n packets of the frame are sent: some are overtaken, some come twice. */
static unsigned send_order(struct cap_gvcam *c, unsigned n, uint32_t *out)
{
    unsigned m = 0;
    for (unsigned k = 0; k < n; k++) {
        out[m++] = c->send.cur->next + k;
        if (m < GVCAM_BATCH - (n - k) && gvcam_chance(c, c->fault.duplicate)) {
            out[m++] = c->send.cur->next + k;
            c->stats.duplicated++;
        }
    }
    for (unsigned k = 0; k + 1 < m; k++)
        if (gvcam_chance(c, c->fault.reorder)) {
            unsigned by = 1 + (unsigned)(pvx_uniform(&c->rng) * 3);
            by = k + by < m ? by : m - 1 - k;
            uint32_t late = out[k];
            memmove(out + k, out + k + 1, by * sizeof out[0]);
            out[k + by] = late;
            c->stats.reordered++;
            k += by;
        }
    return m;
}

/* Send some packets of the present frame. */
static void send_some(struct cap_gvcam *c, unsigned max, int64_t now)
{
    struct batch b;
    uint32_t which[GVCAM_BATCH];
    uint32_t left = c->send.cur->n_data + 2 - c->send.cur->next;
    unsigned n = left < max ? left : max;
    b.to = target(c);
    b.n = 0;
    unsigned m = send_order(c, n, which);
    for (unsigned k = 0; k < m; k++)
        offer(c, c->send.cur, which[k], 0, &b, now);
    flush(c, &b);
    c->send.cur->next += n;
    if (c->send.cur->next == c->send.cur->n_data + 2)
        send_finish(c);
}

static int64_t delay_ns(const struct cap_gvcam *c)
{
    return (int64_t)((double)c->reg.v[GVF_SCPD] * 1e9 / (double)gvcam_clock_hz(&c->clock));
}

/* How long n packets take on the camera's cable, Ethernet's share included. */
static int64_t wire_ns(const struct cap_gvcam *c, unsigned n)
{
    return (int64_t)((double)n * (c->reg.v[GVF_SCPS] + ETHERNET) * 8e3 / c->c.link_mbit);
}

/* The pause between packets is never less than the packet delay: a late packet does not make the next one early.
 * Without a packet delay, the cable may catch up a little. */
int64_t gvcam_send_step(struct cap_gvcam *c, int64_t now)
{
    if (c->reg.v[GVF_SCP_PORT] == 0) {
        if (c->send.q_n > 0 || c->send.cur != NULL)
            gvcam_send_forget(c);
        return GVCAM_NEVER;
    }
    if (c->send.cur == NULL && !send_next_frame(c, now))
        return c->send.q_n > 0 ? c->send.queue[c->send.q_first].send_at : GVCAM_NEVER;
    int64_t delay = delay_ns(c);
    if (now < c->send.packet_at && c->send.packet_at - now <= MAX_PAUSE_NS)
        return c->send.packet_at;
    send_some(c, delay > 0 ? 1 : GVCAM_BATCH / 2, now);
    if (delay > 0)
        c->send.packet_at = pvx_now_real() + delay;
    else
        c->send.packet_at =
            (c->send.packet_at > now - CATCH_UP_NS ? c->send.packet_at : now - CATCH_UP_NS) +
            wire_ns(c, GVCAM_BATCH / 2);
    return c->send.packet_at;
}

/* ---- on request ------------------------------------------------------------------------------- */

static struct gvcam_sent *send_remembered(struct cap_gvcam *c, uint64_t id)
{
    for (size_t k = 0; k < GVCAM_HISTORY; k++)
        if (c->send.history[k].used && c->send.history[k].shot.id == id)
            return &c->send.history[k];
    return NULL;
}

/* Send a packet without data that gives the reason why the requested packet is missing. */
static void say_why(struct cap_gvcam *c, uint16_t status, uint64_t block, uint32_t packet)
{
    uint8_t p[CAP_GVSP_HEAD_WIDE];
    struct cap_gvsp_head h = {status, c->send.wide, CAP_GVSP_DATA, block, packet};
    struct sockaddr_in to = target(c);
    size_t n = cap_gvsp_put_head(p, &h);
    if (gvcam_link_pass(c->link, n + CAP_GVSP_UDP_IP, pvx_now_real(), &c->stats.cut))
        (void)sendto(c->send.fd, p, n, MSG_DONTWAIT, (const struct sockaddr *)&to, sizeof to);
}

void gvcam_send_again(struct cap_gvcam *c, const struct cap_gvcp_resend *r)
{
    struct gvcam_sent *s = send_remembered(c, r->block);
    if (c->reg.v[GVF_SCP_PORT] == 0 || r->first > r->last)
        return;
    if (s == NULL) {
        c->stats.gone += (uint64_t)r->last - r->first + 1 < 65536 ? r->last - r->first + 1 : 1;
        say_why(c, CAP_GVCP_PACKET_REMOVED, r->block, r->first);
        return;
    }
    struct batch b;
    b.to = target(c);
    b.n = 0;
    int64_t now = pvx_now_real();
    for (uint32_t p = r->first; p <= r->last && p < s->n_data + 2; p++) {
        if (s == c->send.cur && p >= s->next) {
            say_why(c, CAP_GVCP_PACKET_NOT_YET, r->block, p);
            break;
        }
        c->stats.resent++;
        offer(c, s, p, CAP_GVSP_RESENT, &b, now);
        if (b.n == GVCAM_BATCH)
            flush(c, &b);
    }
    flush(c, &b);
}

/* Send a test packet as long as a data packet is now.  It must not be fragmented, so it shows whether the size
 * works. */
void gvcam_send_test(struct cap_gvcam *c)
{
    uint8_t p[GVCAM_PACKET_MAX];
    struct sockaddr_in to = target(c);
    size_t n = c->reg.v[GVF_SCPS] - CAP_GVSP_UDP_IP;
    if (to.sin_port == 0)
        return;
    memset(p, 0, n);
    int df = IP_PMTUDISC_PROBE, was = IP_PMTUDISC_DONT;
    (void)setsockopt(c->send.fd, IPPROTO_IP, IP_MTU_DISCOVER, &df, sizeof df);
    if (gvcam_link_pass(c->link, n + CAP_GVSP_UDP_IP, pvx_now_real(), &c->stats.cut) &&
        sendto(c->send.fd, p, n, MSG_DONTWAIT, (const struct sockaddr *)&to, sizeof to) < 0)
        c->stats.send_errors++;
    (void)setsockopt(c->send.fd, IPPROTO_IP, IP_MTU_DISCOVER, &was, sizeof was);
}
