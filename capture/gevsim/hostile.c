/* hostile.c - malformed acknowledges and packets of a broken or hostile camera. */
#include <string.h>

#include "base/clock.h"
#include "capture/gevsim/gevsim.h"

static void hostile_say(struct cap_gvcam *c, int fd, const uint8_t *p, size_t n,
                        const struct sockaddr_in *to)
{
    if (!gvcam_link_pass(c->link, n + CAP_GVSP_UDP_IP, pvx_now_real(), &c->stats.cut))
        return;
    c->stats.hostile++;
    (void)sendto(fd, p, n, MSG_DONTWAIT, (const struct sockaddr *)to, sizeof *to);
}

void gvcam_hostile_acks(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                        const struct sockaddr_in *to)
{
    uint8_t p[CAP_GVCP_MAX];
    memset(p, 0xa5, sizeof p);
    hostile_say(c, c->control.fd, p, 0, to); /* empty */
    hostile_say(c, c->control.fd, p, 3, to); /* shorter than a head */
    cap_gvcp_put_ack(p, CAP_GVCP_OK, r->command, (uint16_t)(r->id + 77), 4);
    hostile_say(c, c->control.fd, p, 12, to); /* to another request */
    cap_gvcp_put_ack(p, CAP_GVCP_OK, r->command, r->id, 500);
    hostile_say(c, c->control.fd, p, CAP_GVCP_HEAD, to); /* announces 500 bytes, has none */
    cap_gvcp_put_ack(p, CAP_GVCP_OK, 0x7770, r->id, 4);
    hostile_say(c, c->control.fd, p, 12, to); /* of an unknown command */
    cap_gvcp_put_command(p, CAP_GVCP_ACK, CAP_GVCP_READREG, r->id, "\0\0\0\0", 4);
    hostile_say(c, c->control.fd, p, 12, to); /* a request instead */
}

/* Send one bad packet about the frame that begins.  It may cost that frame, but no other. */
void gvcam_hostile_packets(struct cap_gvcam *c, const struct gvcam_shot *s,
                           const struct sockaddr_in *to)
{
    uint8_t p[512];
    struct cap_gvsp_head h = {
        .wide = c->send.wide, .content = CAP_GVSP_DATA, .block = s->id, .packet = 1};
    size_t n = sizeof p;
    for (size_t k = 0; k < n; k++)
        p[k] = (uint8_t)(pvx_uniform(&c->rng) * 256);
    switch ((int)(pvx_uniform(&c->rng) * 10)) {
    case 0: n = 0; break;                                         /* empty */
    case 1: n = 1 + (size_t)(pvx_uniform(&c->rng) * 7); break;    /* shorter than a head */
    case 2: h.packet = 0xfffff0; break;                           /* far behind the end */
    case 3: h.block = s->id > 3000 ? s->id - 2000 : 45000; break; /* of no nearby frame */
    case 4: /* never a frame's; but just before the wrap Aravis would take the next hundred as late */
        h.block = !c->send.wide && s->id > 65400 ? s->id - 2000 : 0;
        break;
    case 5: h.content = 0x7d; break;                                /* of an unknown kind */
    case 6: n = CAP_GVSP_HEAD; break;                               /* data packet without data */
    case 7: h.content = CAP_GVSP_LEAD, h.packet = 0, n = 12; break; /* leader cut short */
    case 8: h.content = CAP_GVSP_TRAIL, h.packet = 0xfffffe; break;
    default: h.wide = !c->send.wide, n = 12; break; /* the other kind of number, and cut short */
    }
    if (n >= CAP_GVSP_HEAD) {
        uint8_t head[CAP_GVSP_HEAD_WIDE];
        size_t m = cap_gvsp_put_head(head, &h);
        memcpy(p, head, m < n ? m : n);
    }
    hostile_say(c, c->send.fd, p, n, to);
}
